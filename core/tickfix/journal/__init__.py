"""The append-only record of a run, in MCAP: events, decisions, estimates, snapshots, and what made them.

A journal is a folder of segments ``000001.mcap`` …, see docs/journal.md. :class:`JournalWriter` writes it,
:class:`JournalReader` reads it; payloads are opaque bytes to both.
"""

from tickfix.journal.journal_folder import (
    JournalDamaged,
    JournalError,
    JournalFull,
    JournalLocked,
    JournalOutOfDescriptors,
    JournalSettings,
    is_being_written,
)
from tickfix.journal.journal_reader import JournalReader, ReadStart, SegmentInfo
from tickfix.journal.journal_writer import JournalWriter
from tickfix.journal.segment_layout import JournalRecord, RecordKind, RunManifest
from tickfix.journal.segment_reader import SegmentDamage

__all__ = [
    "JournalDamaged",
    "JournalError",
    "JournalFull",
    "JournalLocked",
    "JournalOutOfDescriptors",
    "JournalReader",
    "JournalRecord",
    "JournalSettings",
    "JournalWriter",
    "ReadStart",
    "RecordKind",
    "RunManifest",
    "SegmentDamage",
    "SegmentInfo",
    "is_being_written",
]
