"""What a journal takes: records and megabytes a second, how long a commit takes, and how long until it is on the disk.

    python benchmarks/journal.py [FOLDER]

FOLDER is where the journals are written, by default the system's temporary folder; it should be on the disk that
matters. Payloads have the sizes of estimates (400 bytes) and of motion batches (6 kB). One thread appends and commits,
as the loop does; the journal's own thread waits for the disk.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from tickfix.journal import JournalReader, JournalSettings, JournalWriter, RecordKind, RunManifest

MANIFEST = RunManifest(run="benchmark", tickfix_version="", config="", seed=0, probe="", wall_start_ns=0)
SHAPES = (  # payload in bytes, records a commit, commits
    (400, 1, 4000),
    (400, 100, 600),
    (400, 1000, 100),
    (6000, 1, 4000),
    (6000, 100, 300),
)


def main() -> None:
    """Measure and print."""
    where = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    print(f"one thread, {platform.machine()}, Python {platform.python_version()}")
    print("commit: p50 and p99 of the call; durable: from the call to the callback, with sync_ms = 5")
    print("payload × records a commit: written; a record appended; commit; durable; read")
    for size, group, commits in SHAPES:
        with tempfile.TemporaryDirectory(dir=where) as folder:
            measure(Path(folder), size, group, commits)


def measure(folder: Path, size: int, group: int, commits: int) -> None:
    """Write one journal, read it back, and print a line."""
    payload = np.random.default_rng(0).bytes(size)
    committed = np.zeros(commits)
    durable = np.zeros(commits)
    appending = 0.0
    done = threading.Event()

    def landed(i: int, begun: float) -> None:
        durable[i] = time.perf_counter() - begun
        if i == commits - 1:
            done.set()

    with JournalWriter(folder, MANIFEST, JournalSettings(sync_ms=5)) as writer:
        first = time.perf_counter()
        for i in range(commits):
            begun = time.perf_counter()
            for k in range(group):
                writer.append(RecordKind.ESTIMATE, "phone-0042", k, payload)
            appended = time.perf_counter()
            writer.commit()
            committed[i] = time.perf_counter() - appended
            appending += appended - begun
            writer.when_durable(writer.next_number - 1, lambda i=i, begun=appended: landed(i, begun))
        taken = time.perf_counter() - first
        done.wait()
    begun = time.perf_counter()
    count = sum(1 for _ in JournalReader(folder).records())
    reading = time.perf_counter() - begun
    assert count == group * commits
    mb = count * size / 1e6
    written = f"{count / taken:9,.0f}/s {mb / taken:4.0f} MB/s; {1e6 * appending / count:4.1f} µs"
    waits = f"{spread(committed, 1e6, 'µs')}; {spread(durable, 1e3, 'ms')}"
    print(f"{size:6} B × {group:4}: {written}; {waits}; {count / reading:9,.0f}/s {mb / reading:4.0f} MB/s")


def spread(values: np.ndarray, scale: float, unit: str) -> str:
    """Return p50 and p99 in their unit."""
    p50, p99 = np.percentile(values * scale, [50, 99])
    return f"{p50:5.0f} {p99:6.0f} {unit}"


if __name__ == "__main__":
    main()
