"""Readers of recordings: the Indoor Location & Navigation format, and tickfix's own event files."""

from tickfix.readers.event_file import EVENT_FILE_SUFFIX, EventFileReader, write_events
from tickfix.readers.indoor_location import IndoorLocationReader

__all__ = ["EVENT_FILE_SUFFIX", "EventFileReader", "IndoorLocationReader", "write_events"]
