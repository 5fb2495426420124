"""A crew of workers says what one replica says, byte by byte, whatever happens in which order."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from lab import EFFORT


def test_worker_pools_of_any_size_say_what_one_replica_says_to_the_byte() -> None:
    script = Path(__file__).with_name("worker_pool_stories.py")
    command = [sys.executable, "-W", "error", str(script), str(3 * EFFORT)]
    done = subprocess.run(command, capture_output=True, check=False, encoding="utf-8", timeout=600 * EFFORT)  # noqa: S603
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    kinds = (
        "MotionSamples",
        "Scan",
        "Fix",
        "Pressure",
        "Truth",
        "AdmitScan",
        "DropScan",
        "RunDevice",
        "FinishDevice",
        "SelectPrimary",
    )
    assert all(told[kind] > 10 for kind in kinds), told
    assert told["estimates"] > 1000
    rare = ("duplicates", "epochs", "snapshots", "forgotten", "remembered", "lost")
    assert all(told[what] > 0 for what in rare), told
    assert told["bytes sent at once"] > 4_000_000
    assert told["bytes answered"] > 1_000_000
