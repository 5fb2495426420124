"""The subcommands by name, each imported when it runs: ``tickfix --help`` needs none of them, and starts at once."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import typer
from typer.core import TyperCommand, TyperGroup


@dataclass(frozen=True, slots=True)
class LazyEntry:
    """A subcommand that is not imported yet.

    Attributes:
        module: of ``tickfix.cli``.
        attribute: the function, or the ``typer.Typer`` of a group of commands.
        help: the first sentence of its help, which the list of commands shows.
    """

    module: str
    attribute: str
    help: str


COMMANDS: Final = {
    "demo": LazyEntry(
        "experiments",
        "demo",
        "See it work: survey a simulated office, track five people through it with several pipelines, and compare.",
    ),
    "survey": LazyEntry(
        "survey",
        "survey",
        "Survey recordings with waypoints: floor plans, radio map, trained models, and walks held out for testing.",
    ),
    "replay": LazyEntry(
        "replay",
        "replay",
        "Replay walks as they were logged, a position every 200 ms, and compare pipelines at the waypoints.",
    ),
    "reproduce": LazyEntry(
        "experiments",
        "reproduce",
        "Run a paper's experiment again on a simulated twin of its site: its tables beside ours, "
        "and which claims hold.",
    ),
    "compare": LazyEntry(
        "compare",
        "compare",
        "Compare pipelines on the same walks: how much better, how surely, where, and at what cost.",
    ),
    "serve": LazyEntry(
        "serve",
        "serve",
        "Follow devices live: sensors in and positions out over ZeroMQ, every 200 ms, with a journal if wanted.",
    ),
    "send": LazyEntry("send", "send", "Play walks to an engine: what is not acknowledged is sent again, until it is."),
    "locate": LazyEntry(
        "send",
        "locate",
        "Locate scans beside an engine, which then needs no fingerprint of its own: scans from it, fixes to it.",
    ),
    "listen": LazyEntry(
        "monitor",
        "listen",
        "Print estimates as they come, and what was missed: gaps in the numbers, heartbeats that did not come.",
    ),
    "status": LazyEntry(
        "monitor",
        "status",
        "Show how an engine is doing: ticks and how late they are, what comes in, what goes out, what fails.",
    ),
    "control": LazyEntry("monitor", "control", "Tell a running engine what to do; what it decides is in its journal."),
    "keys": LazyEntry("keys", "app", "Make keys, and say what each may do."),
    "plugins": LazyEntry("plugins", "app", "List algorithms, readers and sinks, or show one of them."),
    "journal": LazyEntry("journal", "app", "Look into a journal, verify it, or export it."),
}
"""The subcommands in the order in which they are listed."""


class LazyCommandGroup(TyperGroup):
    """A group whose subcommands are those of :data:`COMMANDS`."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - the interface
        """Return the names."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 - the interface
        """Return a command that stands for one not imported yet, None for an unknown name."""
        entry = COMMANDS.get(cmd_name)
        return None if entry is None else LazyCommand(cmd_name, entry)


class LazyCommand(TyperCommand):
    """Stands for a subcommand in the list of commands; parsing its arguments imports it."""

    def __init__(self, name: str, entry: LazyEntry) -> None:
        """Know name and help, and nothing else."""
        super().__init__(name, help=entry.help)
        self._entry = entry

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Return the context of the imported command, which runs from here on."""
        return load_command(self._entry, self.name).make_context(info_name, args, parent=parent, **extra)


def load_command(entry: LazyEntry, name: str | None) -> Any:
    """Import a subcommand and return it as typer builds it."""
    found = getattr(import_module(f"tickfix.cli.{entry.module}"), entry.attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(found)
        command: Any = typer.main.get_command(alone)
    else:
        command = typer.main.get_group(found)
    command.name = name
    return command
