"""Calls of the algorithm under test: what one raises, returns or touches is said as a check that failed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from tickfix.testing.sealed import OutsideError, sealed

T = TypeVar("T")


class ContractError(AssertionError):
    """A check that failed; its text says what was found and what to mend."""


def require(condition: object, message: str) -> None:
    """Fail with ``message`` unless ``condition`` holds."""
    if not condition:
        raise ContractError(message)


def pair_of(returned: Any, kind: type[T]) -> tuple[Any, T]:
    """Return what a ``step`` returned: the next state, and a ``kind``.

    Raises:
        ContractError: for anything else.
    """
    if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[1], kind)):
        raise ContractError(f"step returned {type(returned).__name__}, expected (state, {kind.__name__})")
    pair: tuple[Any, T] = returned
    return pair


@contextmanager
def told(what: str) -> Iterator[None]:
    """Say during which call something was raised."""
    try:
        yield
    except ContractError:
        raise
    except OutsideError as error:
        raise ContractError(
            f"{what} called {error}. Take times from the data and numbers from the rng given"
        ) from error
    except ValueError as error:
        if "read-only" in str(error):
            raise ContractError(f"{what} writes into an array it was given. Make a copy, and change that") from error
        raise ContractError(f"{what} raised ValueError: {error}") from error
    except Exception as error:
        raise ContractError(f"{what} raised {type(error).__name__}: {error}") from error


@contextmanager
def pure(what: str) -> Iterator[None]:
    """As :func:`told`, in a room without clocks and dice."""
    before = np.random.get_state()[1].tobytes()  # type: ignore[index]  # noqa: NPY002 - the very thing
    with told(what), sealed():
        yield
    after = np.random.get_state()[1].tobytes()  # type: ignore[index]  # noqa: NPY002
    require(before == after, f"{what} drew from numpy's global generator. Draw from the rng given")
