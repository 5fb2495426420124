"""The positions port's messages.

Topics, and estimates as canonical bytes (the same bytes are published and journaled).
"""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple, TypeAlias
from urllib.parse import quote, unquote

import msgspec
from msgspec import Struct

from tickfix.api import Belief, Component, Estimate, EventError, Status
from tickfix.wire.sensor_messages import VERSION, FloatArray, FloatRows, Int64, UInt63
from tickfix.wire.validation import WireError, check_version, decode_checked, decode_float_rows, decode_floats

TopicFamily: TypeAlias = Literal["estimate", "revision"]

HEARTBEAT_TOPIC: Final = b"heartbeat"
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
def stream_topics(family: TopicFamily, site: str, floor: str | None, device: str, pipeline: str) -> tuple[bytes, ...]:
    """Return the topics under which a body is published: by floor, and for estimates also by device."""
    place = NO_FLOOR if floor is None else topic_segment(floor)
    by_floor = "/".join((family, topic_segment(site), place, topic_segment(device), topic_segment(pipeline))).encode()
    if family == "revision":
        return (by_floor,)
    return by_floor, "/".join(("device", topic_segment(site), topic_segment(device), topic_segment(pipeline))).encode()


def topic_segment(text: str) -> str:
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


_ESTIMATE_ENCODER: Final = msgspec.msgpack.Encoder()


class ComponentMessage(Struct, kw_only=True, frozen=True):
    """One Gaussian of a mixture.

    Attributes:
        weight: its part of the whole.
        floor: name of the floor.
        xy: mean, metres in the floor's frame, x east and y north.
        covariance: 2 × 2 in m².
    """

    weight: float
    floor: str
    xy: FloatArray
    covariance: FloatRows


class BeliefMessage(Struct, kw_only=True, frozen=True):
    """Where the device is believed to be.

    Attributes:
        floor: the most probable floor; ``xy`` is in its frame.
        xy: mean, metres, x east and y north.
        covariance: 2 × 2 in m².
        floor_probabilities: pairs (floor, probability) that sum to one; none means certainty about ``floor``.
        mixture: Gaussians that sum to the belief, where one would hide that it is ambiguous.
        speed_mps, heading_rad: of walking, clockwise from +y; nil where the filter does not know.
    """

    floor: str
    xy: FloatArray
    covariance: FloatRows
    floor_probabilities: list[tuple[str, float]] = []
    mixture: list[ComponentMessage] = []
    speed_mps: float | None = None
    heading_rad: float | None = None


class EstimateMessage(Struct, tag_field="type", tag="estimate", kw_only=True, frozen=True):
    """The result of a pipeline for a device at a tick.

    Attributes:
        v: protocol version.
        device, pipeline: who is followed, and by which pipeline.
        epoch: counts the starts of the device's clock.
        tick: k.
        t_ns: k · 200 ms of device time, in ns.
        status: how much it can be relied on.
        belief: nil while there is no position.
        motion_age_ns, observation_age_ns: time since motion was measured and since an observation was used last; nil
            before the first.
        innovation_m, nis: of the newest observation of this tick: its distance from what was expected, and the
            normalised square of it; nil without one.
        failed_by: the stage that failed and why, empty when none did.
        reasons: what the filter reported.
        diagnostics: numbers by name that the filter reported, such as ``ess``; absent when there are none.
        revision: 0 as published when the tick closed; each revision counts one up.
    """

    v: UInt63
    device: str
    pipeline: str
    epoch: Int64
    tick: Int64
    t_ns: Int64
    status: Status
    belief: BeliefMessage | None = None
    motion_age_ns: Int64 | None = None
    observation_age_ns: Int64 | None = None
    innovation_m: float | None = None
    nis: float | None = None
    failed_by: str = ""
    reasons: list[str] = []
    diagnostics: dict[str, float] = {}
    revision: Int64 = 0


_ESTIMATE_DECODER: Final = msgspec.msgpack.Decoder(EstimateMessage)


def encode_estimate(estimate: Estimate) -> bytes:
    """Return the estimate's canonical bytes: keys sorted, every field but empty diagnostics present, floats with their
    64 bits.

    Text with lone surrogates, which a plugin's failure may bring, is written with backslashes, since publishing must
    not fail for it; all else comes back from :func:`decode_estimate` bit for bit.

    Raises:
        WireError: for integers beyond 64 bits.
    """
    fields = _estimate_fields(estimate)
    try:
        return _ESTIMATE_ENCODER.encode(fields)
    except UnicodeEncodeError:
        return _ESTIMATE_ENCODER.encode(_escape_surrogates(fields))
    except OverflowError as error:
        raise WireError("estimate", f"an integer: {error}", "integers of 64 bits") from None


def decode_estimate(data: bytes) -> Estimate:
    """Return the estimate of its bytes.

    Raises:
        WireError: for bytes that are no estimate.
    """
    message = decode_checked(_ESTIMATE_DECODER, data)
    check_version(message.v)
    belief = message.belief
    try:
        return Estimate(
            device=message.device,
            pipeline=message.pipeline,
            epoch=message.epoch,
            tick=message.tick,
            t_ns=message.t_ns,
            status=message.status,
            belief=None if belief is None else _build_belief(belief),
            motion_age_ns=message.motion_age_ns,
            observation_age_ns=message.observation_age_ns,
            innovation_m=message.innovation_m,
            nis=message.nis,
            failed_by=message.failed_by,
            reasons=tuple(message.reasons),
            diagnostics=MappingProxyType(message.diagnostics),
            revision=message.revision,
        )
    except EventError as error:
        raise WireError("belief", str(error), "a possible belief") from error


def _build_belief(message: BeliefMessage) -> Belief:
    return Belief(
        floor=message.floor,
        xy=decode_floats("belief.xy", message.xy, 2),
        covariance=decode_float_rows("belief.covariance", message.covariance, 2, 2),
        floor_probabilities=tuple(message.floor_probabilities),
        mixture=tuple(_build_component(f"belief.mixture[{i}]", one) for i, one in enumerate(message.mixture)),
        speed_mps=message.speed_mps,
        heading_rad=message.heading_rad,
    )


def _build_component(field: str, message: ComponentMessage) -> Component:
    return Component(
        weight=message.weight,
        floor=message.floor,
        xy=decode_floats(f"{field}.xy", message.xy, 2),
        covariance=decode_float_rows(f"{field}.covariance", message.covariance, 2, 2),
    )


def _estimate_fields(estimate: Estimate) -> dict[str, Any]:
    belief = estimate.belief
    # Left out when empty, so that the bytes are those of estimates before there were diagnostics.
    diagnostics = {str(name): float(value) for name, value in sorted(estimate.diagnostics.items())}
    return {
        "belief": None if belief is None else _belief_fields(belief),
        "device": estimate.device,
        **({"diagnostics": diagnostics} if diagnostics else {}),
        "epoch": int(estimate.epoch),
        "failed_by": estimate.failed_by,
        "innovation_m": _optional_float(estimate.innovation_m),
        "motion_age_ns": _optional_int(estimate.motion_age_ns),
        "nis": _optional_float(estimate.nis),
        "observation_age_ns": _optional_int(estimate.observation_age_ns),
        "pipeline": estimate.pipeline,
        "reasons": [str(reason) for reason in estimate.reasons],
        "revision": int(estimate.revision),
        "status": str(estimate.status),
        "t_ns": int(estimate.t_ns),
        "tick": int(estimate.tick),
        "type": "estimate",
        "v": VERSION,
    }


def _belief_fields(belief: Belief) -> dict[str, Any]:
    return {
        "covariance": belief.covariance.tolist(),
        "floor": str(belief.floor),
        "floor_probabilities": [(str(floor), float(p)) for floor, p in belief.floor_probabilities],
        "heading_rad": _optional_float(belief.heading_rad),
        "mixture": [
            {
                "covariance": one.covariance.tolist(),
                "floor": str(one.floor),
                "weight": float(one.weight),
                "xy": one.xy.tolist(),
            }
            for one in belief.mixture
        ],
        "speed_mps": _optional_float(belief.speed_mps),
        "xy": belief.xy.tolist(),
    }


def _optional_int(value: int | None) -> int | None:
    return None if value is None else int(value)


def _optional_float(value: float | None) -> float | None:
    return None if value is None else float(value)


def _escape_surrogates(value: Any) -> Any:
    """Return ``value`` with lone surrogates of its texts written with backslashes."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {key: _escape_surrogates(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_escape_surrogates(one) for one in value]
    return value
