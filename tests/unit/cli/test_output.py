"""What the command prints where."""

from __future__ import annotations

import json

import pytest

from tickfix.cli.console import print_json, progress, warn_each


def test_json_is_all_there_is_on_stdout_and_never_holds_a_nan(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"mean_m": 1.5, "name": "Ä"})
    said = capsys.readouterr()
    assert json.loads(said.out) == {"mean_m": 1.5, "name": "Ä"}
    assert said.err == ""
    with pytest.raises(ValueError, match="not JSON compliant"):
        print_json({"mean_m": float("nan")})


def test_the_first_problems_are_told_and_the_rest_counted(capsys: pytest.CaptureFixture[str]) -> None:
    warn_each(tuple(f"problem {i}" for i in range(8)), "problems")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "tickfix: warning: problem 0"
    assert lines[-1] == "tickfix: warning: … and 3 more problems"
    assert len(lines) == 6


def test_progress_goes_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with progress() as show:
        show("reading", 0, 2)
        show("reading", 2, 2)
    said = capsys.readouterr()
    assert said.out == ""
    assert "reading" in said.err
    assert "2/2" in said.err
