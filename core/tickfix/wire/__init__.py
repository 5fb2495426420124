"""Events and estimates as MessagePack: what goes over the ports and into the journal.

Versioned apart from the package: :data:`VERSION` is the protocol's. Nothing here does I/O.
"""

from tickfix.wire.decoding import decode_message, unknown_fields
from tickfix.wire.errors import WireError
from tickfix.wire.estimates import decode_estimate, encode_estimate
from tickfix.wire.events import check_sent, decode_event, encode_event, from_event, to_event, unknown_sensors
from tickfix.wire.limits import MessageLimits
from tickfix.wire.messages import OLDEST_VERSION, VERSION, Bye, Hello, Message
from tickfix.wire.replies import (
    REQUESTS,
    Ack,
    Envelope,
    Error,
    FollowEnvelope,
    Heartbeat,
    Reply,
    Request,
    Welcome,
    decode_request,
    encode,
    error_for,
)
from tickfix.wire.topics import HEARTBEAT, Family, Topic, parse_topic, segment, stream_topics

__all__ = [
    "HEARTBEAT",
    "OLDEST_VERSION",
    "REQUESTS",
    "VERSION",
    "Ack",
    "Bye",
    "Envelope",
    "Error",
    "Family",
    "FollowEnvelope",
    "Heartbeat",
    "Hello",
    "Message",
    "MessageLimits",
    "Reply",
    "Request",
    "Topic",
    "Welcome",
    "WireError",
    "check_sent",
    "decode_estimate",
    "decode_event",
    "decode_message",
    "decode_request",
    "encode",
    "encode_estimate",
    "encode_event",
    "error_for",
    "from_event",
    "parse_topic",
    "segment",
    "stream_topics",
    "to_event",
    "unknown_fields",
    "unknown_sensors",
]
