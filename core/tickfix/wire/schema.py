"""The protocol as JSON Schema, generated from the types::

    python -m tickfix.wire.schema > docs/wire-schema.json

What JSON cannot express: ``contentEncoding: base64`` stands for MessagePack's ``bin``, and NaN and infinities are
numbers.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from typing import Any, Final, get_args

import msgspec

from tickfix.api import LATEST_NS
from tickfix.wire import engine_messages, sensor_messages
from tickfix.wire.estimate_codec import BeliefMessage, ComponentMessage, EstimateMessage
from tickfix.wire.sensor_messages import OLDEST_VERSION, TIME_MARKER, VERSION

MESSAGES_BY_PORT: Final[dict[str, tuple[type[msgspec.Struct], ...]]] = {
    "sensors, from a device": get_args(sensor_messages.DeviceMessage),
    "sensors, to a device": (engine_messages.WelcomeReply, engine_messages.AckReply, engine_messages.ErrorReply),
    "positions": (engine_messages.PublicationEnvelope, EstimateMessage, engine_messages.HeartbeatMessage),
    "control": (engine_messages.ControlRequest, engine_messages.ControlReply, engine_messages.ErrorReply),
    "follow": (
        engine_messages.FollowEnvelope,
        engine_messages.AdmitScan,
        engine_messages.DropScan,
        engine_messages.RunDevice,
        engine_messages.FinishDevice,
        engine_messages.SelectPrimary,
    ),
}
"""Which messages go over which port."""

NESTED_TYPES: Final = (sensor_messages.SensorSamples, BeliefMessage, ComponentMessage)
"""Maps that stand inside of sensor_messages."""

_ROLE_PATTERN: Final = re.compile(r":\w+:`~?([\w.]+)`")
_ATTRIBUTE_PATTERN: Final = re.compile(r"^ {4}(\w[\w, ]*): ")


def build_schema() -> dict[str, Any]:
    """Return the schema of all sensor_messages."""
    types = list(dict.fromkeys([kind for kinds in MESSAGES_BY_PORT.values() for kind in kinds] + list(NESTED_TYPES)))
    _, definitions = msgspec.json.schema_components(types, ref_template="#/$defs/{name}")
    for kind in types:
        definition = definitions[kind.__name__]
        summary, descriptions = _docstring_fields(kind)
        definition["description"] = summary
        _add_time_bounds(definition)
        for name, field in definition["properties"].items():
            if name in descriptions:
                # Beside a reference a description would be lost on older readers; ``allOf`` keeps both.
                if "$ref" in field:
                    field["allOf"] = [{"$ref": field.pop("$ref")}]
                field["description"] = descriptions[name]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "tickfix wire protocol",
        "$comment": "MessagePack: contentEncoding base64 stands for bin; NaN and infinities are numbers.",
        "version": VERSION,
        "oldestVersion": OLDEST_VERSION,
        "ports": {
            port: [{"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds] for port, kinds in MESSAGES_BY_PORT.items()
        },
        "$defs": dict(sorted(definitions.items())),
    }


def _add_time_bounds(schema: Any) -> None:
    """Add the range within which a device's times are used."""
    if isinstance(schema, dict):
        if schema.pop(TIME_MARKER, False):
            schema.update(minimum=0, maximum=LATEST_NS)
        for part in schema.values():
            _add_time_bounds(part)
    elif isinstance(schema, list):
        for part in schema:
            _add_time_bounds(part)


def _docstring_fields(kind: type[msgspec.Struct]) -> tuple[str, dict[str, str]]:
    """Return the first line of a type's docstring, and the descriptions of its attributes, bases included."""
    descriptions: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        name, text = (), ""
        lines = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")[2].splitlines()
        for line in [*lines, "    end: "]:
            match = _ATTRIBUTE_PATTERN.match(line)
            if match:
                descriptions.update(dict.fromkeys(name, text))
                name, text = tuple(match[1].split(", ")), line[match.end() :].strip()
            else:
                text += f" {line.strip()}"
    summary = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
    return _strip_markup(summary), {name: _strip_markup(text) for name, text in descriptions.items()}


def _strip_markup(text: str) -> str:
    """Return a docstring's words without its markup."""
    return _ROLE_PATTERN.sub(r"\1", text).replace("``", "")


def main() -> None:
    """Print the schema."""
    json.dump(build_schema(), sys.stdout, indent=2, ensure_ascii=False)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
