"""Where a comparison takes place: sites, and the walks to run on each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from tickfix.api import Floor
from tickfix.api.packing import pack
from tickfix.drivers.recordings import Source
from tickfix.site.site import Site


@dataclass(frozen=True, slots=True)
class Walk:
    """A recording to run.

    Attributes:
        source: the file and its reader.
        sha256: of the file.
    """

    source: Source
    sha256: str

    @staticmethod
    def of(source: Source) -> Walk:
        """Return the walk of a file."""
        return Walk(source, sha256(source.path.read_bytes()).hexdigest())


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A site and the walks to run on it.

    Attributes:
        name: in reports, where grounds of one name are one; walks are unique within it.
        digest: of all that a run takes from the site.
        site: gives it; called only when a walk must be run.
        walks: in their order.
        floors: to draw walks on.
    """

    name: str
    digest: str
    site: Callable[[], Site]
    walks: tuple[Walk, ...]
    floors: tuple[Floor, ...]


def ground_of(site: Site, name: str, sources: tuple[Source, ...]) -> Ground:
    """Return the ground of a site that is there."""
    return Ground(name, site_digest(site), lambda: site, tuple(Walk.of(source) for source in sources), site.floors)


def site_digest(site: Site) -> str:
    """Return the SHA-256 of what a run takes from a site: floors, radio map, survey tracks and models.

    Name, held-out walks and notes do not matter.
    """
    sha = sha256()
    for floor in site.floors:
        sha.update(pack(floor))
    sha.update(pack(site.radio_map))
    for track in site.survey_tracks:
        sha.update(pack(track))
    for key, model in site.models.items():
        for name, array in sorted(model.items()):
            sha.update(f"{key}\0{name}\0".encode() + _bytes(array))
    return sha.hexdigest()


def _bytes(array: Any) -> bytes:
    described: str = f"{array.dtype.str} {array.shape} "
    content: bytes = array.tobytes()
    return described.encode() + content


def ground_names(sites: Sequence[tuple[Path, Site]]) -> list[str]:
    """Return a name for each site: its own, or the path where several share one."""
    names = [site.name for _, site in sites]
    return [name if names.count(name) == 1 else str(path) for name, (path, _) in zip(names, sites, strict=True)]
