"""docs/python.md: its blocks run as one script, printing what the page says; and the doctests of the face."""

from __future__ import annotations

import doctest
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import tickfix

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text("utf-8")
README = (ROOT / "README.md").read_text("utf-8")
BLOCK = re.compile(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", re.DOTALL)
MARK = "\x1e"


def test_its_blocks_run_and_print_what_it_says(tmp_path: Path) -> None:
    blocks = BLOCK.findall(PAGE)
    assert len(blocks) > 8
    script = tmp_path / "notebook.py"
    script.write_text("\n".join(f"{code}\nprint({MARK!r})" for code, _ in blocks), "utf-8")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "error"}
    done = subprocess.run(  # noqa: S603 - our own page
        [sys.executable, script.name], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    printed = [part.strip() for part in done.stdout.split(MARK)]
    for (code, promised), found in zip(blocks, printed, strict=False):
        assert found == promised.strip(), f"after\n{code}"


@pytest.mark.parametrize("module", ["tickfix.workflow.walks", "tickfix.workflow.fingerprint_estimator"])
def test_the_examples_of_the_docstrings_hold(module: str) -> None:
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


def test_the_readme_uses_names_that_there_are() -> None:
    section = README.partition("## From Python")[2].partition("\n## ")[0]
    names = set(re.findall(r"\btickfix\.(\w+)", section))
    assert len(names) > 4
    assert names <= set(tickfix.__all__)
