"""What the engine says besides estimates: answers on the sensors and control ports, envelopes, heartbeats."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import msgspec
from msgspec import Struct

from tickfix.kernel import Outcome
from tickfix.wire.errors import WireError
from tickfix.wire.heads import check_version, decode_head
from tickfix.wire.messages import VERSION, Count, Int64
from tickfix.wire.raw import shown
from tickfix.wire.refusals import decode_as


class Welcome(Struct, tag_field="type", tag="welcome", kw_only=True, frozen=True):
    """Answers a ``hello``.

    Attributes:
        run: id of the engine's run; a new one means that the engine began anew.
        site: name of the site.
        limits: what a message may hold at most, see :class:`~tickfix.wire.limits.MessageLimits`.
    """

    v: Count
    run: str
    site: str
    limits: dict[str, int]


class Ack(Struct, tag_field="type", tag="ack", kw_only=True, frozen=True):
    """What became of a message that asked for it.

    Attributes:
        device, session, seq: the message's.
        outcome: the intake outcome; after ``busy`` and ``throttled`` the message may be sent again.
        detail: further words, for people.
    """

    v: Count
    device: str
    session: str
    seq: Count
    outcome: Outcome
    detail: str = ""


class Error(Struct, tag_field="type", tag="error", kw_only=True, frozen=True):
    """A message that cannot be used, or a request that cannot be answered: what was found where, what is expected.

    Attributes:
        outcome: the intake outcome.
        field: path of the field, such as ``sensors.gyroscope.values[3]``; ``message`` for the whole.
        found: the value as it was found, shortened.
        expected: what would be understood.
        device, session, seq: those of the message as far as they could be read.
    """

    v: Count
    outcome: Outcome
    field: str
    found: str
    expected: str
    device: str = ""
    session: str = ""
    seq: Count = 0


class Request(Struct, tag_field="type", tag="request", kw_only=True, frozen=True):
    """Asks something of the control port.

    Attributes:
        what: one of :data:`REQUESTS`.
        args: arguments by name.
    """

    v: Count
    what: str
    args: dict[str, Any] = {}


class Reply(Struct, tag_field="type", tag="reply", kw_only=True, frozen=True):
    """Answers a request.

    Attributes:
        what: the request's.
        ok: whether it was done.
        data: the answer, or the reason in words where it was not done.
    """

    v: Count
    what: str
    ok: bool
    data: Any = None


REQUESTS: Final = (
    "status",
    "health",
    "counters",
    "devices",
    "pipelines",
    "plugins",
    "configuration",
    "drain",
    "stop",
    "primary",
    "subscribe-info",
)
"""What the control port can be asked."""


class Envelope(Struct, kw_only=True, frozen=True):
    """Second frame of a publication.

    Attributes:
        run: id of the engine's run.
        seq: counts the publications of one stream (family, device and pipeline) within the run, from 1.
    """

    v: Count
    run: str
    seq: Count


class FollowEnvelope(Struct, kw_only=True, frozen=True):
    """Second frame on the follow port.

    Attributes:
        run: id of the engine's run.
        number: the record's number in the journal, where estimates are counted, too.
        seq: counts what was sent on this port, from 1; 0 is not counted.
    """

    v: Count
    run: str
    number: Count
    seq: Count = 0


class Heartbeat(Struct, tag_field="type", tag="heartbeat", kw_only=True, frozen=True):
    """Says that the engine is alive.

    Attributes:
        run: id of the engine's run.
        site: name of the site.
        wall_ns: the engine's wall clock, ns since 1970.
        uptime_s: seconds since the run began here.
        devices: number of devices followed.
        seq: counts heartbeats, from 1.
    """

    v: Count
    run: str
    site: str
    wall_ns: Int64
    uptime_s: float
    devices: Count
    seq: Count


Answer: TypeAlias = Welcome | Ack | Error | Request | Reply | Heartbeat | Envelope | FollowEnvelope

_ENCODER: Final = msgspec.msgpack.Encoder()
_REQUEST: Final = msgspec.msgpack.Decoder(Request)
_SHOWN: Final = 256
"""Characters of a name that an error repeats."""


def encode(answer: Answer) -> bytes:
    """Return the bytes of anything but events and estimates, which have canonical ones.

    Texts with lone surrogates are the caller's to avoid.

    Raises:
        TypeError, ValueError: for a reply whose data MessagePack cannot hold.
    """
    return _ENCODER.encode(answer)


def error_for(error: WireError, data: bytes = b"") -> Error:
    """Return the message that tells a peer of ``error``; it names the message ``data`` as far as that could be read."""
    try:
        head = decode_head(data)
    except WireError:
        head = {}
    device, session, seq = (head.get(name) for name in ("device", "session", "seq"))
    return Error(
        v=VERSION,
        outcome=error.outcome,
        field=error.field,
        found=error.found,
        expected=error.expected,
        device=device[:_SHOWN] if isinstance(device, str) else "",
        session=session[:_SHOWN] if isinstance(session, str) else "",
        seq=seq if type(seq) is int and 0 <= seq < 2**63 else 0,
    )


def decode_request(data: bytes, message_bytes: int = 65_536) -> Request:
    """Return what the control port is asked.

    Raises:
        WireError: for what is no request, or asks what is not known here (outcome ``unknown``).
    """
    if len(data) > message_bytes:
        raise WireError("message", f"{len(data)} bytes", f"at most {message_bytes}")
    check_version(decode_head(data).get("v"))
    request = decode_as(_REQUEST, data)
    if request.what not in REQUESTS:
        raise WireError("what", shown(request.what), " | ".join(REQUESTS), Outcome.UNKNOWN)
    return request
