"""The one error of this room: it names the field, what was found and what is expected."""

from __future__ import annotations

from tickfix.api import TickfixError
from tickfix.kernel import Outcome


class WireError(TickfixError):
    """Bytes that are no message of this protocol, or one that cannot be used.

    Args:
        field: path of the field, such as ``sensors.gyroscope.values[3]``; ``message`` for the whole.
        found: the value as it was found, shortened.
        expected: what would be understood.
        outcome: the intake outcome it stands for: ``malformed``, or ``unknown`` for what a newer peer may mean.
    """

    def __init__(self, field: str, found: str, expected: str, outcome: Outcome = Outcome.MALFORMED) -> None:
        super().__init__(f"{field}: found {found}; expected {expected}")
        self.field = field
        self.found = found
        self.expected = expected
        self.outcome = outcome

    def __reduce__(self) -> tuple[type[WireError], tuple[str, str, str, Outcome]]:
        """Say how to build it again, so that it can come back from another process."""
        return type(self), (self.field, self.found, self.expected, self.outcome)
