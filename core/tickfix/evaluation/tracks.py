"""A track (the estimates of one pipeline for one device, tick by tick) and its SHA-256 digest."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import msgpack
import numpy as np

from tickfix.api import Belief, Component, Estimate, Floats, Ints
from tickfix.api.arrays import frozen_ints


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Track:
    """What one pipeline said about one device: as published at the time, or as settled in the end.

    Attributes:
        pipeline, device: who said it about whom.
        estimates: n estimates in the order of (epoch, tick), each tick once.
        closed_ns: (n,) int64, non-decreasing: arrival time of the event that made each tick close, which is when its
            estimate was known to anybody.
    """

    pipeline: str
    device: str
    estimates: tuple[Estimate, ...]
    closed_ns: Ints

    def __post_init__(self) -> None:
        """Freeze the times and check the order.

        Raises:
            EventError: when ``closed_ns`` has another length or no integers.
            ValueError: when ticks, or the times at which they closed, run backwards.
        """
        object.__setattr__(self, "estimates", tuple(self.estimates))
        object.__setattr__(self, "closed_ns", frozen_ints("closed_ns", self.closed_ns, len(self.estimates)))
        backwards = np.flatnonzero(self.closed_ns[1:] < self.closed_ns[:-1])
        if backwards.size:
            raise ValueError(f"closed_ns: found a smaller time at index {backwards[0] + 1}, ticks close in their order")
        instants = [(estimate.epoch, estimate.tick) for estimate in self.estimates]
        for i, (before, after) in enumerate(pairwise(instants), start=1):
            if after <= before:
                raise ValueError(f"estimates: found (epoch, tick) {after} at index {i}, expected one after {before}")

    @staticmethod
    def of(pipeline: str, device: str, published: Iterable[tuple[Estimate, int]]) -> Track:
        """Return the track of pairs (estimate, time at which its tick closed), as a driver collects them."""
        pairs = tuple(published)
        closed_ns = np.array([closed for _, closed in pairs], dtype=np.int64)
        return Track(pipeline=pipeline, device=device, estimates=tuple(e for e, _ in pairs), closed_ns=closed_ns)

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.estimates)

    def __iter__(self) -> Iterator[Estimate]:
        """Go through the estimates."""
        return iter(self.estimates)


def digest(track: Iterable[Estimate]) -> str:
    """Return the SHA-256 (64 hex digits) of what a track, or its estimates in tick order, says, bit for bit.

    Hashed is the MessagePack of each estimate in turn, floats and arrays as their 8 IEEE 754 bytes. Left out are the
    pipeline's name, so that two names of one algorithm agree, and the revision: how often a tick was revised tells of
    the order of arrival, on which a settled track must not depend. ``closed_ns`` is left out for the same reason.
    """
    sha = hashlib.sha256()
    packer = msgpack.Packer(use_bin_type=True, unicode_errors="surrogatepass")
    for estimate in track:
        sha.update(packer.pack(_digest_content(estimate)))
    return sha.hexdigest()


def pooled_digest(digests: Iterable[str]) -> str:
    """Return one digest for those of several walks, taken in the order of the walks: SHA-256 of their bytes joined."""
    return hashlib.sha256(b"".join(bytes.fromhex(one) for one in digests)).hexdigest()


def _digest_content(estimate: Estimate) -> tuple[Any, ...]:
    return (
        estimate.device,
        int(estimate.epoch),
        int(estimate.tick),
        int(estimate.t_ns),
        str(estimate.status),
        None if estimate.belief is None else _belief_content(estimate.belief),
        _plain_int(estimate.motion_age_ns),
        _plain_int(estimate.observation_age_ns),
        _plain_float(estimate.innovation_m),
        _plain_float(estimate.nis),
        estimate.failed_by,
        tuple(estimate.reasons),
    )


def _belief_content(belief: Belief) -> tuple[Any, ...]:
    return (
        belief.floor,
        _float64_bytes(belief.xy),
        _float64_bytes(belief.covariance),
        tuple((floor, float(probability)) for floor, probability in belief.floor_probabilities),
        tuple(_component_content(component) for component in belief.mixture),
        _plain_float(belief.speed_mps),
        _plain_float(belief.heading_rad),
    )


def _component_content(component: Component) -> tuple[Any, ...]:
    return float(component.weight), component.floor, _float64_bytes(component.xy), _float64_bytes(component.covariance)


def _float64_bytes(array: Floats) -> bytes:
    return np.asarray(array, dtype="<f8").tobytes()


def _plain_int(value: int | None) -> int | None:
    return None if value is None else int(value)


def _plain_float(value: float | None) -> float | None:
    return None if value is None else float(value)
