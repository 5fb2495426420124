"""Messages that the engine sends besides estimates: replies, envelopes, heartbeats, and the decisions of its loop.

Decisions record what a driver decided and no event shows. Events and decisions in order are the complete input of a
kernel, so applying them again gives the same bytes."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import msgspec
from msgspec import Struct

from tickfix.wire.sensor_messages import VERSION, Int64, UInt63
from tickfix.wire.validation import (
    ReplyOutcome,
    WireError,
    check_version,
    decode_checked,
    decode_scalar_fields,
    short_repr,
)


class WelcomeReply(Struct, tag_field="type", tag="welcome", kw_only=True, frozen=True):
    """Answers a ``hello``.

    Attributes:
        run: id of the engine's run; a new one means that the engine restarted.
        site: name of the site.
        limits: what a message may hold at most, see :class:`~tickfix.wire.sensor_messages.MessageLimits`.
    """

    v: UInt63
    run: str
    site: str
    limits: dict[str, int]


class AckReply(Struct, tag_field="type", tag="ack", kw_only=True, frozen=True):
    """What became of a message that asked for it.

    Attributes:
        device, session, seq: the message's.
        outcome: the intake outcome; after ``busy`` and ``throttled`` the message may be sent again.
        detail: further words, for people.
    """

    v: UInt63
    device: str
    session: str
    seq: UInt63
    outcome: ReplyOutcome
    detail: str = ""


class ErrorReply(Struct, tag_field="type", tag="error", kw_only=True, frozen=True):
    """A message that cannot be used, or a request that cannot be answered: what was found where, what is expected.

    Attributes:
        outcome: the intake outcome.
        field: path of the field, such as ``sensors.gyroscope.values[3]``; ``message`` for the whole.
        found: the value as it was found, shortened.
        expected: what would be understood.
        device, session, seq: those of the message as far as they could be read.
    """

    v: UInt63
    outcome: ReplyOutcome
    field: str
    found: str
    expected: str
    device: str = ""
    session: str = ""
    seq: UInt63 = 0


class ControlRequest(Struct, tag_field="type", tag="request", kw_only=True, frozen=True):
    """Asks something of the control port.

    Attributes:
        what: one of :data:`CONTROL_REQUESTS`.
        args: arguments by name.
    """

    v: UInt63
    what: str
    args: dict[str, Any] = {}


class ControlReply(Struct, tag_field="type", tag="reply", kw_only=True, frozen=True):
    """Answers a request.

    Attributes:
        what: the request's.
        ok: whether it was done.
        data: the answer, or the reason in words where it was not done.
    """

    v: UInt63
    what: str
    ok: bool
    data: Any = None


CONTROL_REQUESTS: Final = (
    "status",
    "health",
    "counters",
    "devices",
    "metrics",
    "pipelines",
    "plugins",
    "configuration",
    "drain",
    "stop",
    "primary",
    "subscribe_info",
)
"""What the control port can be asked."""


class PublicationEnvelope(Struct, kw_only=True, frozen=True):
    """Second frame of a publication.

    Attributes:
        run: id of the engine's run.
        seq: counts the publications of one stream (family, device and pipeline) within the run, from 1.
    """

    v: UInt63
    run: str
    seq: UInt63


class FollowEnvelope(Struct, kw_only=True, frozen=True):
    """Second frame on the follow port.

    Attributes:
        run: id of the engine's run.
        number: the record's number in the journal, where estimates are counted, too.
        seq: counts what was sent on this port, from 1; 0 is not counted.
    """

    v: UInt63
    run: str
    number: UInt63
    seq: UInt63 = 0


class HeartbeatMessage(Struct, tag_field="type", tag="heartbeat", kw_only=True, frozen=True):
    """Sent periodically while the engine is alive.

    Attributes:
        run: id of the engine's run.
        site: name of the site.
        wall_ns: the engine's wall clock, ns since 1970.
        uptime_s: seconds since the run began here.
        devices: number of devices followed.
        seq: counts heartbeats, from 1.
    """

    v: UInt63
    run: str
    site: str
    wall_ns: Int64
    uptime_s: float
    devices: UInt63
    seq: UInt63


EngineMessage: TypeAlias = (
    WelcomeReply
    | AckReply
    | ErrorReply
    | ControlRequest
    | ControlReply
    | HeartbeatMessage
    | PublicationEnvelope
    | FollowEnvelope
)

_MESSAGE_ENCODER: Final = msgspec.msgpack.Encoder()
_REQUEST_DECODER: Final = msgspec.msgpack.Decoder(ControlRequest)
_MAX_ECHO_CHARS: Final = 256
"""Characters of a name that an error repeats."""


def encode_engine_message(answer: EngineMessage) -> bytes:
    """Return the bytes of anything but events and estimates, which have canonical ones.

    Texts with lone surrogates are the caller's to avoid.

    Raises:
        TypeError, ValueError: for a reply whose data MessagePack cannot hold.
    """
    return _MESSAGE_ENCODER.encode(answer)


def error_reply(error: WireError, data: bytes = b"") -> ErrorReply:
    """Return the reply that reports ``error`` to a peer; it names the message ``data`` as far as that could be read."""
    try:
        head = decode_scalar_fields(data)
    except WireError:
        head = {}
    device, session, seq = (head.get(name) for name in ("device", "session", "seq"))
    return ErrorReply(
        v=VERSION,
        outcome=error.outcome,
        field=error.field,
        found=error.found,
        expected=error.expected,
        device=device[:_MAX_ECHO_CHARS] if isinstance(device, str) else "",
        session=session[:_MAX_ECHO_CHARS] if isinstance(session, str) else "",
        seq=seq if type(seq) is int and 0 <= seq < 2**63 else 0,
    )


def decode_request(data: bytes, message_bytes: int = 65_536) -> ControlRequest:
    """Return what the control port is asked.

    Raises:
        WireError: for what is no request, or asks what is not known here (outcome ``unknown``).
    """
    if len(data) > message_bytes:
        raise WireError("message", f"{len(data)} bytes", f"at most {message_bytes}")
    check_version(decode_scalar_fields(data).get("v"))
    request = decode_checked(_REQUEST_DECODER, data)
    if request.what not in CONTROL_REQUESTS:
        raise WireError("what", short_repr(request.what), " | ".join(CONTROL_REQUESTS), ReplyOutcome.UNKNOWN)
    return request


class AdmitScan(msgspec.Struct, tag_field="type", tag="fold", kw_only=True, frozen=True):
    """A scan that was located beside the loop enters its timeline now; ``number`` is the record that holds it."""

    number: int


class DropScan(msgspec.Struct, tag_field="type", tag="drop", kw_only=True, frozen=True):
    """A scan was not located in time and never enters its timeline."""

    number: int
    reason: str


class RunDevice(msgspec.Struct, tag_field="type", tag="run", kw_only=True, frozen=True):
    """What is due for a device is folded; ``tick`` closes the ticks up to it though the data has not passed them.

    At most ``most`` ticks are closed, unless it is None.
    """

    device: str
    tick: int | None = None
    most: int | None = None


class FinishDevice(msgspec.Struct, tag_field="type", tag="finish", kw_only=True, frozen=True):
    """No more data is expected of a device: it sent ``bye``, or nothing for too long."""

    device: str
    reason: str


class SelectPrimary(msgspec.Struct, tag_field="type", tag="primary", kw_only=True, frozen=True):
    """From now on this pipeline's estimates are the ones that are published."""

    pipeline: str


Decision: TypeAlias = AdmitScan | DropScan | RunDevice | FinishDevice | SelectPrimary

_DECISION_ENCODER: Final = msgspec.msgpack.Encoder()
_DECISION_DECODER: Final[msgspec.msgpack.Decoder[Any]] = msgspec.msgpack.Decoder(Decision)


def encode_decision(decision: Decision) -> bytes:
    """Return the bytes of a decision."""
    return _DECISION_ENCODER.encode(decision)


def decode_decision(data: bytes) -> Decision:
    """Return the decision whose bytes these are.

    Raises:
        tickfix.wire.WireError: when they are none.
    """
    decision: Decision = decode_checked(_DECISION_DECODER, data)
    return decision
