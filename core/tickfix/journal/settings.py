"""Settings of a journal."""

from __future__ import annotations

from dataclasses import dataclass

from tickfix.api.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalSettings:
    """How a journal is cut into segments, when it is on the disk, and how much of it is kept.

    Attributes:
        sync_ms: how long what is committed may wait for the disk; a loss of power loses at most this and the time
            that the disk takes. The death of the process loses nothing that is committed.
        segment_mb, segment_s: size and age at which a new segment is wanted.
        keep_mb, keep_s: old segments are dropped when the folder holds more than this, or when they were last written
            longer ago; None keeps them. The newest segment that begins with a snapshot, and what follows, always stay.
    """

    sync_ms: float = 50.0
    segment_mb: float = 64.0
    segment_s: float = 900.0
    keep_mb: float | None = None
    keep_s: float | None = None

    def __post_init__(self) -> None:
        """Check that every limit is one.

        Raises:
            ConfigError: naming the setting.
        """
        for name in self.__slots__:
            value = getattr(self, name)
            if name == "sync_ms" and not value >= 0:
                raise ConfigError("journal.sync_ms", repr(value), "a number ≥ 0")
            if name != "sync_ms" and value is not None and not value > 0:
                raise ConfigError(f"journal.{name}", repr(value), "a number > 0")
