"""What the engine says besides estimates: answers on the sensors and control ports, envelopes, heartbeats."""

from __future__ import annotations

from typing import Final, TypeAlias

import msgspec

from tickfix.kernel import Outcome
from tickfix.wire.errors import WireError
from tickfix.wire.heads import check_version, decode_head
from tickfix.wire.messages import (
    REQUESTS,
    VERSION,
    Ack,
    Envelope,
    Error,
    FollowEnvelope,
    Heartbeat,
    Reply,
    Request,
    Welcome,
)
from tickfix.wire.raw import shown
from tickfix.wire.refusals import decode_as

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
