"""Topics of the positions port: what a listener can subscribe to by prefix."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, Literal, NamedTuple, TypeAlias
from urllib.parse import quote, unquote

from tickfix.wire.errors import WireError

Family: TypeAlias = Literal["estimate", "revision"]

HEARTBEAT: Final = b"heartbeat"
NO_FLOOR: Final = "-"
"""Stands for the floor while there is no position; a floor of this name is written ``%2D``."""


class Topic(NamedTuple):
    """A topic taken apart; ``floor`` is None while there is no position, and under ``device/``."""

    family: str
    site: str
    floor: str | None
    device: str
    pipeline: str


@lru_cache(maxsize=8192)
def stream_topics(family: Family, site: str, floor: str | None, device: str, pipeline: str) -> tuple[bytes, ...]:
    """Return the topics under which a body is published: by floor, and for estimates also by device."""
    place = NO_FLOOR if floor is None else segment(floor)
    by_floor = "/".join((family, segment(site), place, segment(device), segment(pipeline))).encode()
    if family == "revision":
        return (by_floor,)
    return by_floor, "/".join(("device", segment(site), segment(device), segment(pipeline))).encode()


def segment(text: str) -> str:
    """Return a name as it stands in a topic: percent-encoded UTF-8, letters, digits and ``_.~-`` as they are.

    ``-`` alone means that there is none, so the name ``-`` is written ``%2D``; an empty name is an empty segment.
    """
    return "%2D" if text == NO_FLOOR else quote(text, safe="", errors="backslashreplace")


def parse_topic(topic: bytes) -> Topic:
    """Return the names in a topic of an estimate or revision.

    Raises:
        WireError: for any other topic.
    """
    family, *names = topic.decode("ascii", "replace").split("/")
    if family in {"estimate", "revision"} and len(names) == 4:
        site, floor, device, pipeline = names
        place = None if floor == NO_FLOOR else unquote(floor)
        return Topic(family, unquote(site), place, unquote(device), unquote(pipeline))
    if family == "device" and len(names) == 3:
        site, device, pipeline = names
        return Topic(family, unquote(site), None, unquote(device), unquote(pipeline))
    expected = "estimate/SITE/FLOOR/DEVICE/PIPELINE, revision/… or device/SITE/DEVICE/PIPELINE"
    raise WireError("topic", repr(topic[:80]), expected)
