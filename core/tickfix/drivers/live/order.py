"""What an engine is told to serve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tickfix.config import Config


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What to serve.

    Attributes:
        site: folder of the site.
        config: pipelines, and the tables ``[live]``, ``[ports]`` and ``[journal]``.
        journal: folder; None keeps no journal.
        resume: go on with the journal's newest run.
        follow: address of another engine's follow port; then its events and decisions are folded, and no sensors.
        follow_key: own key for that port, as a file with ``engine.pub`` beside it; None where none is asked for.
        disabled: keys and labels of stages that must not run; pipelines that need one are left out.
    """

    site: Path
    config: Config
    journal: Path | None = None
    resume: bool = False
    follow: str = ""
    follow_key: Path | None = None
    disabled: Mapping[str, str] = field(default_factory=dict)
