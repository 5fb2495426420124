"""Errors that name what was found, where, and what to do about it."""

from __future__ import annotations

from typing import ClassVar


class TickfixError(Exception):
    """Root of every error that tickfix raises on purpose; its text is meant for the user as it stands.

    The errors of :mod:`tickfix.client`, which imports nothing else of tickfix, have a root of their own, its
    ``ClientError``, with kinds of the same sort.

    Attributes:
        kind: what sort of error it is, a snake_case word that stays when the text changes.
    """

    kind: ClassVar[str] = "error"


class EventError(TickfixError, ValueError):
    """An event that cannot be: names the field, the value found and what is expected."""

    kind: ClassVar[str] = "event"


class ConfigError(TickfixError):
    """A setting that cannot be used.

    Args:
        where: file and key, such as ``ab.toml: pipelines.b.fingerprint.k``.
        found: the value as it was found.
        expected: what would be allowed.
    """

    kind: ClassVar[str] = "config"

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(f"{where}: found {found}; expected {expected}")
        self.where = where
        self.found = found
        self.expected = expected

    def __reduce__(self) -> tuple[type[ConfigError], tuple[str, ...]]:
        """Pickle by the constructor's arguments, so that a worker process can raise it in its parent."""
        return type(self), (self.where, self.found, self.expected)


class PluginError(TickfixError):
    """A plugin or algorithm that breaks its contract: names it, the problem and how to fix it."""

    kind: ClassVar[str] = "plugin"

    def __init__(self, plugin: str, problem: str, fix: str) -> None:
        super().__init__(f"{plugin}: {problem}. {fix}")
        self.plugin = plugin
        self.problem = problem
        self.fix = fix

    def __reduce__(self) -> tuple[type[PluginError], tuple[str, str, str]]:
        """Pickle by the constructor's arguments, so that a worker process can raise it in its parent."""
        return type(self), (self.plugin, self.problem, self.fix)


class SiteError(TickfixError):
    """A site folder that cannot be read or built: names the file and the remedy."""

    kind: ClassVar[str] = "site"


class ReaderError(TickfixError):
    """A recording that cannot be read at all (single broken lines are counted, not raised)."""

    kind: ClassVar[str] = "reader"


class PortError(TickfixError):
    """A port that cannot be opened or used: names the address, the cause and the remedy."""

    kind: ClassVar[str] = "port"
