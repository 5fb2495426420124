"""Events and estimates as MessagePack: what goes over the ports and into the journal.

Versioned apart from the package: :data:`VERSION` is the protocol's. Nothing here does I/O.
"""

from tickfix.wire.decoding import decode_message, unknown_fields
from tickfix.wire.errors import WireError
from tickfix.wire.estimates import decode_estimate, encode_estimate
from tickfix.wire.events import decode_event, encode_event, from_event, to_event, unknown_sensors
from tickfix.wire.limits import MessageLimits
from tickfix.wire.messages import OLDEST_VERSION, VERSION, Bye, Hello, Message

__all__ = [
    "OLDEST_VERSION",
    "VERSION",
    "Bye",
    "Hello",
    "Message",
    "MessageLimits",
    "WireError",
    "decode_estimate",
    "decode_event",
    "decode_message",
    "encode_estimate",
    "encode_event",
    "from_event",
    "to_event",
    "unknown_fields",
    "unknown_sensors",
]
