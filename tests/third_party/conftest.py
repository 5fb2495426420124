"""Third-party packages, installed for one test as pip would: on the path, with their metadata."""

from __future__ import annotations

import importlib
import sys
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import Distribution, EntryPoint
from pathlib import Path

import pytest

HERE = Path(__file__).parent
Install = Callable[[str], list[EntryPoint]]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Put the package in the folder of this name on the path; return its entry points, read from its metadata."""
    known = set(sys.modules)

    def installed(folder: str) -> list[EntryPoint]:
        project = tomllib.loads((HERE / folder / "pyproject.toml").read_text("utf-8"))["project"]
        info = tmp_path / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n", "utf-8"
        )
        lines = [f"{name} = {value}" for name, value in project["entry-points"]["tickfix.plugins"].items()]
        (info / "entry_points.txt").write_text("\n".join(["[tickfix.plugins]", *lines]) + "\n", "utf-8")
        monkeypatch.syspath_prepend(HERE / folder)
        importlib.invalidate_caches()
        return list(Distribution.at(info).entry_points)

    yield installed
    for name in set(sys.modules) - known:
        del sys.modules[name]
