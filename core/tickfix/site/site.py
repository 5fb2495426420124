"""The site as a value: floors, radio map, survey tracks, held-out walks and trained models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Floats, Floor, Ints, RadioMap, SiteError, frozen


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurveyTrack:
    """The polyline of one surveyed walk on one floor.

    Attributes:
        walk: name of the recording.
        floor: name of the floor.
        chain: name of the first walk of its chain.
        t_ns: (n,) int64, times of the waypoints, increasing.
        xy: (n, 2) float64, metres, floor frame.
    """

    walk: str
    floor: str
    chain: str
    t_ns: Ints
    xy: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutWalk:
    """A walk kept out of the survey, to be tested on.

    Attributes:
        walk: name of the recording.
        floor: name of the floor, empty for a walk over several.
        chain: name of the first walk of its chain.
        path: the file, absolute; None for a simulated walk.
        sha256: hexadecimal digest of the file; empty for a simulated walk.
    """

    walk: str
    floor: str
    chain: str
    path: Path | None = None
    sha256: str = ""

    def file(self) -> Path:
        """Return the path, after checking that the file is still the one that was held out.

        Raises:
            SiteError: when it is gone or has changed.
        """
        if self.path is None:
            raise SiteError(f"held-out walk {self.walk}: it was simulated and has no file")
        if not self.path.is_file():
            raise SiteError(f"held-out walk {self.walk}: {self.path} is gone; put it back or survey again")
        if file_sha256(self.path) != self.sha256:
            raise SiteError(f"held-out walk {self.walk}: {self.path} has changed since the survey; survey again")
        return self.path


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Site:
    """A building as it was surveyed; ``dataclasses.replace(site, models=…)`` gives one with models.

    Attributes:
        name: of the building.
        floors: in the order of their level and name.
        radio_map: over the floors of that name.
        survey_tracks: where the surveyors walked; ``radio_map.sample_chain`` numbers their chains by name.
        held_out: the walks to test on.
        models: trained models: key → name → array.
        notes: what the survey counted.
    """

    name: str
    floors: tuple[Floor, ...]
    radio_map: RadioMap
    survey_tracks: tuple[SurveyTrack, ...] = ()
    held_out: tuple[HeldOutWalk, ...] = ()
    models: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=lambda: MappingProxyType({}))
    notes: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        """Freeze models and notes.

        Raises:
            SiteError: when two floors share a name.
        """
        names = [floor.name for floor in self.floors]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise SiteError(f"site {self.name!r}: found several floors called {', '.join(twice)}; names must be unique")
        models = {
            key: MappingProxyType({name: frozen(array, np.asarray(array).dtype) for name, array in model.items()})
            for key, model in sorted(self.models.items())
        }
        object.__setattr__(self, "models", MappingProxyType(models))
        object.__setattr__(self, "notes", MappingProxyType(dict(sorted(self.notes.items()))))

    def floor(self, name: str) -> Floor:
        """Return the floor of that name.

        Raises:
            SiteError: when there is none.
        """
        for floor in self.floors:
            if floor.name == name:
                return floor
        known = ", ".join(floor.name for floor in self.floors) or "no floors at all"
        raise SiteError(f"site {self.name!r}: found no floor {name!r}; it has {known}")


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    return sha256(path.read_bytes()).hexdigest()
