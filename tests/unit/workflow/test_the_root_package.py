"""``import tickfix`` offers every name, and imports nothing heavy before one is used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import tickfix


def modules_after(code: str) -> set[str]:
    """Return the modules that a fresh interpreter has imported after ``code``."""
    script = f"{code}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)  # noqa: S603
    return set(done.stdout.split("\n")[-2].split())


def test_importing_it_imports_nothing_heavy() -> None:
    loaded = modules_after("import tickfix")
    assert not loaded & {"numpy", "scipy", "matplotlib", "pandas", "msgspec", "zmq", "shapely", "typer", "pluggy"}
    assert {name for name in loaded if name.startswith("tickfix.")} == set()


def test_its_types_and_functions_need_no_matplotlib() -> None:
    uses = "import tickfix\n" + "\n".join(f"tickfix.{name}" for name in tickfix.__all__)
    assert "matplotlib" not in modules_after(uses)


@pytest.mark.parametrize("name", tickfix.__all__)
def test_every_name_is_there_and_documented(name: str) -> None:
    value = getattr(tickfix, name)
    assert name in dir(tickfix)
    assert name == "__version__" or value.__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'surveys'"):
        _ = tickfix.surveys  # type: ignore[attr-defined]


def test_type_checkers_see_the_same_names_as_the_interpreter() -> None:
    assert tickfix.__file__ is not None
    tree = ast.parse(Path(tickfix.__file__).read_text("utf-8"))
    seen = {
        (f"{node.module}.{alias.name}", alias.asname or alias.name)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If)
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {name for _, name in seen} == set(tickfix.__all__)
    for origin, name in seen:
        module, _, attribute = origin.rpartition(".")
        assert getattr(sys.modules[module], attribute) is getattr(tickfix, name)
