"""Where ``--out`` writes: the sink whose suffix fits the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tickfix.api import ConfigError, Estimate, PluginError
from tickfix.plugins import Offer, Registry


def sink_for(path: Path, found: Registry) -> Offer:
    """Return the sink for files like ``path``.

    Raises:
        ConfigError: listing the suffixes there are.
    """
    known: dict[str, Offer] = {}
    for offer in found.of_kind("sink"):
        for suffix in getattr(offer.cls, "suffixes", ()):
            known.setdefault(suffix, offer)
    if path.suffix.lower() not in known:
        expected = ", ".join(f"{suffix} ({offer.name})" for suffix, offer in sorted(known.items()))
        raise ConfigError(f"--out {path}", f"suffix {path.suffix!r}", f"one of {expected or 'none: no sink is there'}")
    return known[path.suffix.lower()]


@dataclass(frozen=True, slots=True)
class Target:
    """A file and the sink that writes it."""

    offer: Offer
    path: Path


@contextmanager
def opened(target: Target) -> Iterator[Callable[[Estimate], None]]:
    """Open the sink, give its ``write``, and close it; after an error it is told to discard, where it can.

    Raises:
        PluginError: when it cannot be opened.
    """
    try:
        sink = target.offer.cls(target.path)
    except Exception as error:
        raise PluginError(target.offer.label, f"cannot write {target.path}: {error}", "Choose another --out") from error
    try:
        yield sink.write
    except BaseException:
        getattr(sink, "discard", sink.close)()
        raise
    sink.close()
