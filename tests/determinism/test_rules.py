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
def test_kernel_and_algorithms_import_no_clock_rng_threads_or_io(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        assert not {name.split(".")[0] for name in names} & FORBIDDEN, f"{path}: imports {names}"


@pytest.mark.parametrize("path", PURE, ids=lambda path: str(path.relative_to(ROOT)))
def test_kernel_and_algorithms_draw_from_the_generator_they_are_given(path: Path) -> None:
    if path.name == "determinism.py":  # it makes the generators
        return
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            assert node.attr == "Generator", f"{path}:{node.lineno}: numpy.random.{node.attr}"


PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_test_and_file_that_a_page_names_exists(page: Path) -> None:
    text = page.read_text("utf-8")
    folders = "benchmarks|core|docs|examples|papers|plugins|tests"
    for path, test in re.findall(rf"`((?:{folders})/[\w./-]+)(?:::(\w+))?`", text):
        if page.name == "write-a-plugin.md" and path == "tests/test_smoother.py":  # of the package it describes
            continue
        found = ROOT / path
        assert found.exists(), f"{page.name} names {path}"
        assert not test or f"def {test}(" in found.read_text("utf-8"), f"{page.name} names {path}::{test}"
    for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / link).exists(), f"{page.name} links to {link}"
    for test in re.findall(r"`(test_\w+)`", text):
        assert any(f"def {test}(" in p.read_text("utf-8") for p in (ROOT / "tests").rglob("test_*.py")), test
