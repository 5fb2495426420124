"""The append-only record of a run, in MCAP: events, decisions, estimates, snapshots, and what made them.

A journal is a folder of segments ``000001.mcap`` …, see docs/journal.md. :class:`JournalWriter` writes it,
:class:`JournalReader` reads it; payloads are opaque bytes to both.
"""

from tickfix.journal.errors import JournalCrowded, JournalDamaged, JournalError, JournalFull, JournalLocked
from tickfix.journal.folder import is_being_written
from tickfix.journal.manifest import Manifest
from tickfix.journal.reader import JournalReader, Segment, Since
from tickfix.journal.records import Kind, Record
from tickfix.journal.segment_reader import Damage
from tickfix.journal.settings import JournalSettings
from tickfix.journal.writer import JournalWriter

__all__ = [
    "Damage",
    "JournalCrowded",
    "JournalDamaged",
    "JournalError",
    "JournalFull",
    "JournalLocked",
    "JournalReader",
    "JournalSettings",
    "JournalWriter",
    "Kind",
    "Manifest",
    "Record",
    "Segment",
    "Since",
    "is_being_written",
]
