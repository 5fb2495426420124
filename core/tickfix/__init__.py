"""tickfix follows people indoors: motion sensors and Wi-Fi scans in, a position every 200 ms out.

From Python (docs/python.md is the tour)::

    import tickfix

    site = tickfix.survey("site1/F1", holdout=0.3)
    walk = tickfix.read("walk.txt")
    track = tickfix.track(walk, site, "fusion")
    track.to_pandas()
    tickfix.compare(["wifi", "fusion"], None, site).report("ab/")

Names are imported when they are first used, so ``import tickfix`` itself is quick. Plugin authors import
:mod:`tickfix.api`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tickfix.api import Fix, Floor, RadioMap, Recording, Scan, TickfixError, Truth
    from tickfix.evaluation.tracks import Track
    from tickfix.registry import discover
    from tickfix.site import FingerprintTable, Site
    from tickfix.version import __version__
    from tickfix.workflow.comparing import Comparison, compare
    from tickfix.workflow.fingerprint_estimator import (
        FingerprintEstimator,
        FingerprintEvaluation,
        evaluate_fingerprint,
    )
    from tickfix.workflow.pipelines import TickfixWarning
    from tickfix.workflow.sites import site_from_fingerprints, survey
    from tickfix.workflow.tracking import AsyncEngine as Engine
    from tickfix.workflow.tracking import track, track_all
    from tickfix.workflow.walks import read, read_all, recording

__all__ = [
    "Comparison",
    "Engine",
    "FingerprintEstimator",
    "FingerprintEvaluation",
    "FingerprintTable",
    "Fix",
    "Floor",
    "RadioMap",
    "Recording",
    "Scan",
    "Site",
    "TickfixError",
    "TickfixWarning",
    "Track",
    "Truth",
    "__version__",
    "compare",
    "discover",
    "evaluate_fingerprint",
    "read",
    "read_all",
    "recording",
    "site_from_fingerprints",
    "survey",
    "track",
    "track_all",
]

_HOMES = {
    "api": ("Fix", "Floor", "RadioMap", "Recording", "Scan", "TickfixError", "Truth"),
    "evaluation.tracks": ("Track",),
    "registry": ("discover",),
    "site": ("FingerprintTable", "Site"),
    "version": ("__version__",),
    "workflow.comparing": ("Comparison", "compare"),
    "workflow.fingerprint_estimator": ("FingerprintEstimator", "FingerprintEvaluation", "evaluate_fingerprint"),
    "workflow.pipelines": ("TickfixWarning",),
    "workflow.sites": ("site_from_fingerprints", "survey"),
    "workflow.tracking": ("AsyncEngine", "track", "track_all"),
    "workflow.walks": ("read", "read_all", "recording"),
}
_RENAMED = {"Engine": "AsyncEngine"}
_HOME_OF = {name: f"tickfix.{home}" for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module 'tickfix' has no attribute {name!r}")
    original = _RENAMED.get(name, name)
    value = getattr(import_module(_HOME_OF[original]), original)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
