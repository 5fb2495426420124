"""A process that writes a journal as fast as it can and says, on its standard output, what it was promised.

    python journal_child.py FOLDER FIRST_NUMBER LIMIT_BYTES

Every line is a word and a number: ``committed N``, ``durable N``, ``full N`` (records that had to be discarded).
"""

from __future__ import annotations

import os
import random
import resource
import sys
from functools import partial
from pathlib import Path

from tickfix.journal import JournalFull, JournalSettings, JournalWriter, RecordKind, RunManifest

MANIFEST = RunManifest(
    run="r-1", tickfix_version="0.1.0", config="", seed=0, probe="", wall_start_ns=1, plugins={"tickfix": "0.1.0"}
)
KINDS = (RecordKind.EVENT, RecordKind.DECISION, RecordKind.ESTIMATE, RecordKind.REVISION)


def payload_of(number: int) -> bytes:
    """Return what record ``number`` holds: from a few bytes to some hundred thousand."""
    rng = random.Random(number)  # noqa: S311 - any bytes will do, the same every time
    return rng.randbytes(rng.choice((0, 9, 300, 5000, 200_000 if number % 50 == 0 else 60)))


def say(word: str, number: int) -> None:
    """Tell the parent, in one write, or die with it."""
    os.write(1, f"{word} {number}\n".encode())


def main(folder: Path, first_number: int, limit_bytes: int) -> None:
    """Write until killed; where files may not grow beyond a limit, until there was no room three times."""
    if limit_bytes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
    rng = random.Random(first_number)  # noqa: S311
    settings = JournalSettings(sync_ms=3, segment_mb=100 if limit_bytes else 0.3)
    writer = JournalWriter(folder, MANIFEST, settings, first_number=first_number)
    refused = 0
    while refused < 3:
        for _ in range(rng.randint(1, 40)):
            number = writer.next_number
            writer.append(rng.choice(KINDS), f"phone-{number % 5}", number, payload_of(number))
        try:
            writer.commit()
        except JournalFull:
            refused += 1
            say("full", writer.discard())
            writer.roll_segment(payload_of(writer.next_number))
            continue
        say("committed", number)
        writer.when_durable(number, partial(say, "durable", number))
        if writer.should_roll_segment():
            writer.roll_segment(payload_of(writer.next_number))
            say("committed", writer.next_number - 1)
    writer.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
