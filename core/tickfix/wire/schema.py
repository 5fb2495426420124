"""The protocol as JSON Schema, made of the types themselves::

    python -m tickfix.wire.schema > docs/wire-schema.json

What JSON cannot say: ``contentEncoding: base64`` stands for MessagePack's ``bin``, and NaN and infinities are numbers.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from typing import Any, Final, get_args

import msgspec

from tickfix.api import LATEST_NS
from tickfix.wire import decisions, messages, replies
from tickfix.wire.estimates import BeliefMessage, ComponentMessage, EstimateMessage
from tickfix.wire.messages import OLDEST_VERSION, TIME, VERSION

PORTS: Final[dict[str, tuple[type[msgspec.Struct], ...]]] = {
    "sensors, from a device": get_args(messages.Message),
    "sensors, to a device": (replies.Welcome, replies.Ack, replies.Error),
    "positions": (replies.Envelope, EstimateMessage, replies.Heartbeat),
    "control": (replies.Request, replies.Reply, replies.Error),
    "follow": (
        replies.FollowEnvelope,
        decisions.Fold,
        decisions.Drop,
        decisions.Run,
        decisions.Finish,
        decisions.Primary,
    ),
}
"""Which messages go over which port."""

PARTS: Final = (messages.SensorBatch, BeliefMessage, ComponentMessage)
"""Maps that stand inside of messages."""

_ROLE: Final = re.compile(r":\w+:`~?([\w.]+)`")
_ATTRIBUTE: Final = re.compile(r"^ {4}(\w[\w, ]*): ")


def document() -> dict[str, Any]:
    """Return the schema of all messages."""
    types = list(dict.fromkeys([kind for kinds in PORTS.values() for kind in kinds] + list(PARTS)))
    _, definitions = msgspec.json.schema_components(types, ref_template="#/$defs/{name}")
    for kind in types:
        definition = definitions[kind.__name__]
        summary, described = _described(kind)
        definition["description"] = summary
        _bound_times(definition)
        for name, field in definition["properties"].items():
            if name in described:
                # Beside a reference a description would be lost on older readers; ``allOf`` keeps both.
                if "$ref" in field:
                    field["allOf"] = [{"$ref": field.pop("$ref")}]
                field["description"] = described[name]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "tickfix wire protocol",
        "$comment": "MessagePack: contentEncoding base64 stands for bin; NaN and infinities are numbers.",
        "version": VERSION,
        "oldestVersion": OLDEST_VERSION,
        "ports": {port: [{"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds] for port, kinds in PORTS.items()},
        "$defs": dict(sorted(definitions.items())),
    }


def _bound_times(schema: Any) -> None:
    """Say within which limits a device's times are used."""
    if isinstance(schema, dict):
        if schema.pop(TIME, False):
            schema.update(minimum=0, maximum=LATEST_NS)
        for part in schema.values():
            _bound_times(part)
    elif isinstance(schema, list):
        for part in schema:
            _bound_times(part)


def _described(kind: type[msgspec.Struct]) -> tuple[str, dict[str, str]]:
    """Return the first line of a type's docstring, and what it and its bases say of each attribute."""
    described: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        name, text = (), ""
        lines = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")[2].splitlines()
        for line in [*lines, "    end: "]:
            begun = _ATTRIBUTE.match(line)
            if begun:
                described.update(dict.fromkeys(name, text))
                name, text = tuple(begun[1].split(", ")), line[begun.end() :].strip()
            else:
                text += f" {line.strip()}"
    summary = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
    return _plain(summary), {name: _plain(text) for name, text in described.items()}


def _plain(text: str) -> str:
    """Return a docstring's words without its markup."""
    return _ROLE.sub(r"\1", text).replace("``", "")


def main() -> None:
    """Print the schema."""
    json.dump(document(), sys.stdout, indent=2, ensure_ascii=False)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
