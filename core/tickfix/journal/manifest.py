"""What made a run: every segment begins with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from types import MappingProxyType
from typing import Final

FORMAT: Final = "1"
"""Version of the journal's format, see docs/journal.md."""

_PLUGIN: Final = "plugin/"
_NOTE: Final = "note/"
_PLAIN: Final = ("format", "run", "tickfix", "config", "seed", "probe", "wall_start_ns", "first_number")


class ManifestError(ValueError):
    """Entries that are no manifest."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """What made a run, and with which record a segment begins.

    Attributes:
        run: id of the run.
        tickfix_version: of the package.
        config: the configuration file's text.
        seed: of all random streams.
        probe: what :func:`tickfix.kernel.probe.numeric_probe` said.
        wall_start_ns: when the run began, nanoseconds since 1970.
        plugins: versions by distribution.
        notes: what else the run wants remembered (the site, say).
        first_number: number of the segment's first record; the writer fills it in.
    """

    run: str
    tickfix_version: str
    config: str
    seed: int
    probe: str
    wall_start_ns: int
    plugins: Mapping[str, str] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    first_number: int = 1

    def __post_init__(self) -> None:
        """Freeze the mappings, sorted: equal manifests become equal bytes."""
        for name in ("plugins", "notes"):
            object.__setattr__(self, name, MappingProxyType(dict(sorted(getattr(self, name).items()))))

    def entries(self) -> dict[str, str]:
        """Return it as the entries of an MCAP metadata record, with a checksum, which MCAP does not have there."""
        plain = (FORMAT, self.run, self.tickfix_version, self.config, str(self.seed), self.probe)
        result = dict(zip(_PLAIN, (*plain, str(self.wall_start_ns), str(self.first_number)), strict=True))
        result |= {_PLUGIN + name: version for name, version in self.plugins.items()}
        result |= {_NOTE + name: text for name, text in self.notes.items()}
        return result | {"sha256": _checksum(result)}


def parse_manifest(entries: Mapping[str, str]) -> Manifest:
    """Return the manifest that became these entries.

    Raises:
        ManifestError: when its checksum differs, or another version of the format wrote it.
    """
    rest = dict(entries)
    told = rest.pop("sha256", "none")
    if told != _checksum(rest):
        raise ManifestError(f"the manifest's checksum is {_checksum(rest)}, expected {told}")
    if rest.get("format") != FORMAT:
        raise ManifestError(f"a journal of format {rest.get('format')}, expected {FORMAT}: an older tickfix reads it")
    try:
        plain = {name: rest.pop(name) for name in _PLAIN}
        return Manifest(
            run=plain["run"],
            tickfix_version=plain["tickfix"],
            config=plain["config"],
            seed=int(plain["seed"]),
            probe=plain["probe"],
            wall_start_ns=int(plain["wall_start_ns"]),
            plugins={k.removeprefix(_PLUGIN): v for k, v in rest.items() if k.startswith(_PLUGIN)},
            notes={k.removeprefix(_NOTE): v for k, v in rest.items() if k.startswith(_NOTE)},
            first_number=int(plain["first_number"]),
        )
    except (KeyError, ValueError) as error:
        raise ManifestError(f"a manifest without a usable {error}") from error


def _checksum(entries: Mapping[str, str]) -> str:
    digest = sha256()
    for key, value in sorted(entries.items()):
        for text in (key, value):
            raw = text.encode()
            digest.update(len(raw).to_bytes(8, "little") + raw)
    return digest.hexdigest()
