"""A journal's records as JSON, one object a line, for programs that know nothing of tickfix."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import msgspec
import numpy as np

from tickfix.api import TickfixError
from tickfix.journal.records import Kind, Record
from tickfix.wire import decode_estimate, decode_event
from tickfix.wire.decisions import decode_decision

_DECODERS: Final = {
    Kind.EVENT: decode_event,
    Kind.DECISION: decode_decision,
    Kind.ESTIMATE: decode_estimate,
    Kind.REVISION: decode_estimate,
}


def as_json_line(record: Record) -> bytes | None:
    """Return a record as a line of JSON; None for a snapshot, which says nothing that the others do not.

    Beside ``number``, ``kind`` and ``wall_ns`` stand ``type`` (the class, such as ``Scan`` or ``Run``) and its fields
    under their own names; arrays are lists, row by row, and numbers that are not finite are null.

    Raises:
        TickfixError: when the payload is none of its kind.
    """
    decode = _DECODERS.get(record.kind)
    if decode is None:
        return None
    content: Any = decode(record.payload)
    head = {"number": record.number, "kind": record.kind, "wall_ns": record.wall_ns, "type": type(content).__name__}
    fields = msgspec.to_builtins(content, enc_hook=_plain)
    fields.pop("type", None)
    return _encode(head | fields) + b"\n"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TickfixError(f"a record's field holds {type(value).__name__}, which JSON cannot say")


_encode: Final = msgspec.json.Encoder().encode
