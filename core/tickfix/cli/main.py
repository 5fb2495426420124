"""The ``tickfix`` command: its subcommands, and how it fails."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated, Final

import typer

from tickfix.cli.lazy_commands import LazyCommandGroup
from tickfix.version import __version__

RENAMED_OPTIONS: Final = {
    ("compare", "--spare"): "--holdout-share",
    ("reproduce", "--choices"): "--twin-settings",
    ("serve", "--feed"): "--follow-bind",
}
"""(subcommand, option of an earlier release) → its new name."""

app = typer.Typer(
    name="tickfix",
    cls=LazyCommandGroup,
    help="Follow people indoors: motion sensors and Wi-Fi scans in, a position every 200 ms out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


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
            from tickfix.config import RenamedKeyError  # noqa: PLC0415 - slow to import, and seldom needed

            raise RenamedKeyError(f"{arguments[0]} {option}", new_name)


def main() -> None:
    """Run the command; an error that the user can correct is printed as one line, with exit code 2."""
    try:
        refuse_renamed_options(sys.argv[1:])
        app()
    except Exception as error:
        if not isinstance(error, _user_errors()):
            raise
        sys.stderr.write(f"tickfix: {error}\n")
        sys.exit(2)


def _user_errors() -> tuple[type[Exception], ...]:
    """Return the errors that the user can correct; imported only once something failed, as they bring numpy along."""
    from tickfix.api import TickfixError  # noqa: PLC0415
    from tickfix.client import ClientError  # noqa: PLC0415

    return TickfixError, ClientError, OSError


if __name__ == "__main__":
    main()
