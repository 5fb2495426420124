"""The real command in a process of its own, and how hypothesis searches: as in ``tests/``."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")

Reproduce = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def reproduce() -> Reproduce:
    """Run ``tickfix reproduce`` with arguments; ``env`` adds variables, ``code`` is the exit code to expect."""

    def run(*arguments: object, env: dict[str, str] | None = None, code: int = 0) -> subprocess.CompletedProcess[str]:
        environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
        done = subprocess.run(  # noqa: S603 - our own command
            [sys.executable, "-m", "tickfix.cli.main", "reproduce", *map(str, arguments)],
            capture_output=True,
            check=False,
            encoding="utf-8",
            env={**environment, "PYTHONUTF8": "1", **(env or {})},
            timeout=300,
        )
        assert done.returncode == code, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done

    return run
