"""Another process says the same, whatever its hash seed, its order of pipelines and its number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from lab import filter_names

SCRIPT = Path(__file__).parent / "digests.py"


def digests(hash_seed: str, *arguments: str) -> dict[str, list[str]]:
    """Run the script in a process of its own."""
    environment = os.environ | {"PYTHONHASHSEED": hash_seed, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, str(SCRIPT), *arguments],
        capture_output=True,
        check=True,
        env=environment,
        text=True,
        timeout=120,
    )
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


def test_two_processes_publish_and_settle_the_same_bytes() -> None:
    one, other = digests("1"), digests("2", "backwards")
    assert set(one) == set(filter_names())
    assert one == other
    assert len({d for pair in one.values() for d in pair}) > len(one), "all tracks alike: nothing was tracked"
