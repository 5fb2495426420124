"""The real command in real processes, on a small simulated floor stored as recordings."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from tickfix.simulation import office_building, simulate_survey

sys.path.insert(0, str(Path(__file__).parent))

from live_lab import Lab
from stored_floor import Command, write_plan, write_walk

_ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "COLUMNS"} | {"PYTHONUTF8": "1"}


@pytest.fixture(scope="session")
def tickfix() -> Command:
    """Run ``tickfix`` with arguments; ``env`` adds variables, ``code`` is the exit code to expect."""
    if not entry_points(group="tickfix.plugins"):
        pytest.skip("tickfix is not installed here: pip install '.[test]'")

    def run(
        *arguments: object, env: Mapping[str, str] | None = None, code: int = 0, cwd: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(  # noqa: S603 - our own command
            [sys.executable, "-m", "tickfix.cli.main", *map(str, arguments)],
            capture_output=True,
            check=False,
            cwd=cwd,
            encoding="utf-8",
            env=_ENVIRONMENT | dict(env or {}),
            timeout=300,
        )
        assert done.returncode == code, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done

    return run


@pytest.fixture(scope="session")
def floor_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A floor of a simulated office in the indoor-location format: plan and walks."""
    building = office_building(np.random.default_rng(3), width_m=48.0, height_m=24.0, access_points=12)
    folder = tmp_path_factory.mktemp("building") / "F1"
    walks = folder / "path_data_files"
    walks.mkdir(parents=True)
    write_plan(building.floors[0], folder)
    for walk in simulate_survey(building, "F1", np.random.default_rng(4), spacing_m=6.0, length_m=45.0):
        write_walk(walk.recording, walks)
    return folder


@pytest.fixture(scope="session")
def site(tickfix: Command, floor_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The floor, surveyed, with some walks held out."""
    out = tmp_path_factory.mktemp("sites") / "office"
    tickfix("survey", floor_folder, "--out", out, "--holdout", "0.4")
    return out


@pytest.fixture
def lab(site: Path, tmp_path: Path) -> Iterator[Lab]:
    """Start engines, senders and listeners on the site; all are ended with the test."""
    lab = Lab(site, tmp_path)
    yield lab
    lab.end()


@pytest.fixture
def package(tmp_path: Path) -> Callable[..., Mapping[str, str]]:
    """Install, for one process, a stranger's package of one module; return the environment to run with."""

    def install(name: str, source: str) -> Mapping[str, str]:
        (tmp_path / f"{name}.py").write_text(source, encoding="utf-8")
        info = tmp_path / f"{name}-2.5.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.5\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[tickfix.plugins]\n{name} = {name}\n", encoding="utf-8")
        return {"PYTHONPATH": str(tmp_path)}

    return install
