"""``tickfix --help`` imports no subcommand, and says of each what the subcommand says of itself."""

from __future__ import annotations

import subprocess
import sys

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from tickfix.cli.lazy_commands import COMMANDS, load_command
from tickfix.cli.main import app


def modules_after(*arguments: str) -> set[str]:
    """Return the modules that a fresh ``tickfix`` has imported when it exits."""
    script = (
        "import atexit, sys; atexit.register(lambda: sys.stderr.write(' '.join(sys.modules)));"
        f"sys.argv = {['tickfix', *arguments]!r}; from tickfix.cli.main import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)  # noqa: S603
    return set(done.stderr.split())


@pytest.mark.parametrize("arguments", [("--help",), ("--version",)])
def test_it_starts_without_numpy(arguments: tuple[str, ...]) -> None:
    loaded = modules_after(*arguments)
    assert "tickfix.cli.main" in loaded
    assert not loaded & {
        "numpy",
        "scipy",
        "matplotlib",
        "zmq",
        "msgspec",
        "shapely",
        "tickfix.api",
        "tickfix.cli.serve",
    }


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_says_of_a_command_what_it_says_of_itself(name: str) -> None:
    command = load_command(COMMANDS[name], name)
    assert command.name == name
    assert " ".join((command.help or "").partition("\n\n")[0].split()) == COMMANDS[name].help
    shown = CliRunner().invoke(app, [name, "--help"])
    assert shown.exit_code == 0
    assert f"tickfix {name}" in shown.output


def test_every_command_is_listed() -> None:
    shown = CliRunner().invoke(app, ["--help"]).output
    assert all(name in shown for name in COMMANDS)
    assert get_command(app).name == "tickfix"


def test_an_unknown_command_is_refused() -> None:
    shown = CliRunner().invoke(app, ["replya"])
    assert shown.exit_code == 2
    assert "replya" in shown.output
