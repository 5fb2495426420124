"""Events and estimates as MessagePack: what goes over the ports and into the journal.

Versioned apart from the package: :data:`VERSION` is the protocol's. Nothing here does I/O.
"""

from tickfix.wire.engine_messages import (
    CONTROL_REQUESTS,
    AckReply,
    ControlReply,
    ControlRequest,
    ErrorReply,
    FollowEnvelope,
    HeartbeatMessage,
    PublicationEnvelope,
    WelcomeReply,
    decode_request,
    encode_engine_message,
    error_reply,
)
from tickfix.wire.estimate_codec import (
    HEARTBEAT_TOPIC,
    Topic,
    TopicFamily,
    decode_estimate,
    encode_estimate,
    parse_topic,
    stream_topics,
    topic_segment,
)
from tickfix.wire.event_codec import (
    check_received_event,
    decode_event,
    decode_message,
    encode_event,
    event_to_message,
    message_to_event,
    unknown_fields,
)
from tickfix.wire.sensor_messages import OLDEST_VERSION, VERSION, Bye, DeviceMessage, Hello, MessageLimits
from tickfix.wire.validation import ReplyOutcome, WireError

__all__ = [
    "CONTROL_REQUESTS",
    "HEARTBEAT_TOPIC",
    "OLDEST_VERSION",
    "VERSION",
    "AckReply",
    "Bye",
    "ControlReply",
    "ControlRequest",
    "DeviceMessage",
    "ErrorReply",
    "FollowEnvelope",
    "HeartbeatMessage",
    "Hello",
    "MessageLimits",
    "PublicationEnvelope",
    "ReplyOutcome",
    "Topic",
    "TopicFamily",
    "WelcomeReply",
    "WireError",
    "check_received_event",
    "decode_estimate",
    "decode_event",
    "decode_message",
    "decode_request",
    "encode_engine_message",
    "encode_estimate",
    "encode_event",
    "error_reply",
    "event_to_message",
    "message_to_event",
    "parse_topic",
    "stream_topics",
    "topic_segment",
    "unknown_fields",
]
