"""Options of an earlier release are refused with the new name, and the new one exists."""

from __future__ import annotations

import sys

import pytest

from tickfix.cli.lazy_commands import COMMANDS, load_command
from tickfix.cli.main import RENAMED_OPTIONS, main


@pytest.mark.parametrize(("subcommand", "old"), RENAMED_OPTIONS)
@pytest.mark.parametrize("value", [[], ["x"]], ids=["=x", "x"])
def test_an_old_option_is_refused_with_the_new_name(
    subcommand: str, old: str, value: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [subcommand, "F1.site", *([old, *value] if value else [f"{old}=x"])]
    monkeypatch.setattr(sys, "argv", ["tickfix", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    new = RENAMED_OPTIONS[subcommand, old]
    assert capsys.readouterr().err == f"tickfix: {subcommand} {old}: renamed, use {new}\n"


@pytest.mark.parametrize(("subcommand", "old"), RENAMED_OPTIONS)
def test_the_new_option_exists_and_the_old_one_does_not(subcommand: str, old: str) -> None:
    command = load_command(COMMANDS[subcommand], subcommand)
    options = {option for parameter in command.params for option in parameter.opts}
    assert RENAMED_OPTIONS[subcommand, old] in options
    assert old not in options
