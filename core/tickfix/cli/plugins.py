"""``tickfix plugins``: which algorithms there are, and what they take."""

from __future__ import annotations

import difflib
import inspect
import re
from typing import Annotated, Any, Final

import msgspec
import typer
from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from tickfix.api import ConfigError, NoParams
from tickfix.api.algorithms import KINDS
from tickfix.cli.console import print_json, registry, stdout
from tickfix.config import ParameterInfo, describe_parameters
from tickfix.registry import DeclaredSource, Offer, Registry, discover

app = typer.Typer(help="List algorithms, readers and sinks, or show one of them.", pretty_exceptions_enable=False)

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


@app.callback(invoke_without_command=True)
def list_plugins(context: typer.Context, *, as_json: AsJson = False) -> None:
    """List algorithms, readers and sinks with their origin, and what had to be left out."""
    if context.invoked_subcommand is not None:
        return
    plugins = discover()
    if as_json:
        problems = [
            {
                "plugin": p.plugin,
                "value": p.value,
                "distribution": p.distribution,
                "version": p.version,
                "problem": p.problem,
                "fix": p.fix,
            }
            for p in plugins.problems
        ]
        sources = [_source_json(one) for one in plugins.declared.values()]
        offers = [_offer_json(offer) for offer in plugins.offers]
        print_json({"plugins": offers, "sources": sources, "problems": problems})
        return
    console = stdout()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    for column in ("kind", "name", "from"):
        table.add_column(column, no_wrap=True)
    table.add_column("what it does", overflow="fold")
    for offer in plugins.offers:
        table.add_row(offer.kind, offer.name, _origin(offer), _summary(offer))
    for one in plugins.declared.values():
        columns = ", ".join(f"{name} ({unit})" if unit else name for name, unit in one.source.columns.items())
        what = f"{one.source.doc} {one.source.shape.capitalize()}: {columns}".strip()
        table.add_row("source", one.source.name, _origin(one), what)
    console.print(table)
    for problem in plugins.problems:
        console.print(f"left out: {problem}", soft_wrap=True)


@app.command()
def show(
    label: Annotated[str, typer.Argument(metavar="KIND:NAME", help="Such as those that `tickfix plugins` lists.")],
    *,
    as_json: AsJson = False,
) -> None:
    """Show what an algorithm does, where it comes from, its parameters and presets."""
    offer = _find_offer(registry(), label)
    fields = _fields(offer)
    presets = getattr(offer.cls, "presets", {})
    if as_json:
        described = _offer_json(offer) | {
            "doc": _doc(offer),
            "batch_tolerance": _batch_tolerance(offer),
            "parameters": [_parameter_json(field) for field in fields],
            "presets": {
                name: {"source": preset.source, "values": msgspec.to_builtins(dict(preset.values))}
                for name, preset in presets.items()
            },
        }
        print_json(described)
        return
    console = stdout()
    console.print(f"{offer.label}, from {_origin(offer)}", style="bold", soft_wrap=True)
    console.print(Padding(_doc(offer) or "It has no description.", (1, 0, 0, 0)))
    if source := getattr(offer.cls, "source", ""):
        console.print(f"\nSource: {source}", soft_wrap=True)
    if suffixes := getattr(offer.cls, "suffixes", ()):
        console.print(f"\nFiles: {', '.join(suffixes)}", soft_wrap=True)
    if fields:
        _print_fields(console, fields)
    elif offer.kind in ("pdr", "fingerprint", "filter", "map"):
        console.print("\nIt has no parameters.")
    if tolerance := _batch_tolerance(offer):
        console.print(f"\nBatches: equal to one device at a time within {tolerance:g}, not bit for bit.")
    for name, preset in presets.items():
        values = ", ".join(f"{key} = {_toml_value(value)}" for key, value in preset.values.items())
        console.print(f"\nPreset {name!r}, {preset.source}: {values}", soft_wrap=True)


def _find_offer(plugins: Registry, label: str) -> Offer:
    """Return the offer called ``kind:name``; the name alone will do where only one kind has it."""
    kind, colon, name = label.partition(":")
    if colon and kind in KINDS:
        return plugins.get(kind, name)
    labels = [offer.label for offer in plugins.offers]
    alike = [offer for offer in plugins.offers if offer.name == label]
    if len(alike) == 1:
        return alike[0]
    near = [offer.label for offer in alike] or difflib.get_close_matches(label, labels, 1)
    near = near or [
        offer.label for offer in plugins.offers if offer.name in difflib.get_close_matches(label, [offer.name])
    ]
    hint = f" (did you mean {' or '.join(near)}?)" if near else ""
    raise ConfigError("plugins show", repr(label), f"one of {', '.join(labels)}{hint}")


def _offer_json(offer: Offer) -> dict[str, Any]:
    return {
        "kind": offer.kind,
        "name": offer.name,
        "plugin": offer.plugin,
        "value": offer.value,
        "distribution": offer.distribution,
        "version": offer.version,
        "summary": _summary(offer),
        "source": getattr(offer.cls, "source", ""),
    }


def _source_json(one: DeclaredSource) -> dict[str, Any]:
    return {
        "name": one.source.name,
        "shape": one.source.shape,
        "columns": dict(one.source.columns),
        "doc": one.source.doc,
        "plugin": one.plugin,
        "value": one.value,
        "distribution": one.distribution,
        "version": one.version,
    }


def _batch_tolerance(offer: Offer) -> float:
    return float(getattr(offer.cls, "batch_tolerance", 0.0))


def _origin(offer: Offer | DeclaredSource) -> str:
    return f"{offer.distribution} {offer.version}".strip() or offer.plugin


def _summary(offer: Offer) -> str:
    return _doc(offer).partition("\n")[0]


_ROLE_PATTERN: Final = re.compile(r":(?:\w+:)?\w+:`(?:[^`<]*<)?([~!]?)([\w.]+)>?(?:\(\))?`")


def _doc(offer: Offer) -> str:
    """Return the class's docstring without Sphinx's roles and double backquotes."""

    def name(match: re.Match[str]) -> str:
        shortened, target = match.groups()
        return target.rpartition(".")[2] if shortened == "~" else target

    return _ROLE_PATTERN.sub(name, inspect.getdoc(offer.cls) or "").replace("``", "")


def _fields(offer: Offer) -> tuple[ParameterInfo, ...]:
    params = getattr(offer.cls, "Params", NoParams)
    return () if params is NoParams else describe_parameters(offer.cls)


def _parameter_json(field: ParameterInfo) -> dict[str, Any]:
    return {
        "name": field.name,
        "type": field.type,
        "unit": field.unit,
        "default": msgspec.to_builtins(field.default),
        "doc": field.doc,
        "source": field.source,
        "trains": field.trains,
        "formerly": field.formerly,
    }


def _print_fields(console: Console, fields: tuple[ParameterInfo, ...]) -> None:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    for column in ("parameter", "default", "unit"):
        table.add_column(column, no_wrap=True)
    for column in ("allowed", "what it is", "source"):
        table.add_column(column, overflow="fold")
    for field in fields:
        learnt = f"{field.doc} *" if field.trains else field.doc
        table.add_row(field.name, _toml_value(field.default), field.unit, field.type, learnt, field.source)
    console.print(table)
    if renamed := ", ".join(f"{field.name} (formerly {field.formerly})" for field in fields if field.formerly):
        console.print(f"Renamed: {renamed}", soft_wrap=True)
    if any(field.trains for field in fields):
        console.print("* What is learnt from a survey depends on it: survey again, with --config, when it changes.")


def _toml_value(value: Any) -> str:
    """Return a value as it would stand in TOML, nearly."""
    plain = msgspec.to_builtins(value)
    if isinstance(plain, bool):
        return "true" if plain else "false"
    return f'"{plain}"' if isinstance(plain, str) else "–" if plain is None else str(plain)
