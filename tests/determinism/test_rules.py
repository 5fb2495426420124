"""What code may not touch, that results depend on what was measured only; and that promises name their tests."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FORBIDDEN = {
    "asyncio", "concurrent", "datetime", "multiprocessing", "os", "pickle", "random", "secrets", "socket",
    "subprocess", "threading", "time", "uuid",
}  # fmt: skip
PURE = sorted(
    path
    for folder in ("core/tickfix/api", "core/tickfix/kernel", "plugins")
    for path in (ROOT / folder).rglob("*.py")
    if path.name != "recordings.py"
)


@pytest.mark.parametrize("path", PURE, ids=lambda path: str(path.relative_to(ROOT)))
def test_kernel_and_algorithms_import_no_clock_dice_threads_or_outside(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        assert not {name.split(".")[0] for name in names} & FORBIDDEN, f"{path}: imports {names}"


@pytest.mark.parametrize("path", PURE, ids=lambda path: str(path.relative_to(ROOT)))
def test_kernel_and_algorithms_draw_from_the_generator_they_are_given(path: Path) -> None:
    if path.name == "randomness.py":
        return
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            assert node.attr == "Generator", f"{path}:{node.lineno}: numpy.random.{node.attr}"


@pytest.mark.parametrize("name", ["determinism.md", "architecture.md"])
def test_every_test_and_file_that_a_page_names_exists(name: str) -> None:
    text = (ROOT / "docs" / name).read_text("utf-8")
    for path, test in re.findall(r"`((?:tests|core|plugins|examples)/[\w./-]+)(?:::(\w+))?`", text):
        found = ROOT / path
        assert found.exists(), f"docs/{name} names {path}"
        assert not test or f"def {test}(" in found.read_text("utf-8"), f"docs/{name} names {path}::{test}"
    for test in re.findall(r"`(test_\w+)`", text):
        assert any(f"def {test}(" in p.read_text("utf-8") for p in (ROOT / "tests").rglob("test_*.py")), test
