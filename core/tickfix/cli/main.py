"""The ``tickfix`` command: its subcommands, and how it fails."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated, Final

import typer

from tickfix.api import TickfixError
from tickfix.cli.compare import compare
from tickfix.cli.experiments import demo, reproduce
from tickfix.cli.journal import app as journal_app
from tickfix.cli.keys import app as keys_app
from tickfix.cli.monitor import control, listen, status
from tickfix.cli.plugins import app as plugins_app
from tickfix.cli.replay import replay
from tickfix.cli.send import locate, send
from tickfix.cli.serve import serve
from tickfix.cli.survey import survey
from tickfix.client import ClientError
from tickfix.config import RenamedKeyError
from tickfix.version import __version__

RENAMED_OPTIONS: Final = {
    ("compare", "--spare"): "--holdout-share",
    ("reproduce", "--choices"): "--twin-settings",
    ("serve", "--feed"): "--follow-bind",
}
"""(subcommand, option of an earlier release) → its new name."""

app = typer.Typer(
    name="tickfix",
    help="Follow people indoors: motion sensors and Wi-Fi scans in, a position every 200 ms out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(demo)
app.command()(survey)
app.command()(replay)
app.command()(reproduce)
app.command()(compare)
app.command()(serve)
app.command()(send)
app.command()(locate)
app.command()(listen)
app.command()(status)
app.command()(control)
app.add_typer(keys_app, name="keys")
app.add_typer(plugins_app, name="plugins")
app.add_typer(journal_app, name="journal")


def _version(asked: bool) -> None:  # noqa: FBT001 - the shape of a typer callback
    if asked:
        typer.echo(f"tickfix {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    *,
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Follow people indoors: motion sensors and Wi-Fi scans in, a position every 200 ms out."""


def refuse_renamed_options(arguments: Sequence[str]) -> None:
    """Check the arguments of the command (without its own name) for options of an earlier release.

    Raises:
        RenamedKeyError: naming the old option and the new one.
    """
    for argument in arguments[1:]:
        option = argument.partition("=")[0]
        if new_name := RENAMED_OPTIONS.get((arguments[0], option)):
            raise RenamedKeyError(f"{arguments[0]} {option}", new_name)


def main() -> None:
    """Run the command; an error that the user can correct is printed as one line, with exit code 2."""
    try:
        refuse_renamed_options(sys.argv[1:])
        app()
    except (TickfixError, ClientError, OSError) as error:
        sys.stderr.write(f"tickfix: {error}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
