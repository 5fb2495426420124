"""Work spread over processes gives what one process gives."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tickfix.api import ReaderError, TickfixError
from tickfix.replay.process_pool import parallel_map

# In a process of its own: forking belongs into a program with one thread, which a test runner is not.
SCRIPT = """
from types import MappingProxyType
import numpy as np
from tickfix.api import ConfigError, TickfixError
from tickfix.replay.process_pool import parallel_map

offset = np.arange(3.0)

def work(n):
    if n < 0:
        raise ConfigError("here", str(n), "a number ≥ 0")
    array = offset + n
    array.flags.writeable = False
    return MappingProxyType({"array": array, "objects": np.array(["x", None], dtype=object), "n": n})

one, two = (list(parallel_map(work, range(20), processes=p)) for p in (1, 2))
assert [a["n"] for a in two] == list(range(20))
for a, b in zip(one, two):
    assert type(b) is MappingProxyType
    assert a["array"].tobytes() == b["array"].tobytes() and a["array"].dtype == b["array"].dtype
    assert not b["array"].flags.writeable
try:
    list(parallel_map(work, [1, -5, 2], processes=2))
except TickfixError as error:
    print(error)
"""


def test_results_are_in_order_the_same_and_read_only_and_errors_arrive() -> None:
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    done = subprocess.run(command, capture_output=True, check=False, encoding="utf-8", timeout=300)  # noqa: S603
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == "here: found -5; expected a number ≥ 0"


def test_one_process_keeps_the_error_as_it_is() -> None:
    def fail(item: int) -> int:
        raise ReaderError(f"no {item}")

    with pytest.raises(ReaderError, match="no 1") as caught:
        list(parallel_map(fail, [1, 2], processes=1))
    assert isinstance(caught.value, TickfixError)


SPAWNING = """
import math
from tickfix.replay import process_pool

process_pool.start_method = lambda: "spawn"
if __name__ == "__main__":
    print(list(process_pool.parallel_map(math.sqrt, [1.0, 4.0, 9.0], processes=2)))
    offset = 10.0
    print(list(process_pool.parallel_map(lambda x: x + offset, [1.0, 2.0], processes=2)))
"""


def test_spawned_processes_give_the_same_and_what_cannot_be_pickled_stays_in_this_one(tmp_path: Path) -> None:
    script = tmp_path / "spawning.py"
    script.write_text(SPAWNING)
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-W", "error", script],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[1.0, 2.0, 3.0]\n[11.0, 12.0]\n", "")
