"""``tickfix status``: how a running engine is doing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich import box
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tickfix.cli.output import print_json, print_json_line, stdout
from tickfix.client import ClientError, Control, Keys, NoAnswerError

_PERIOD_S: Final = 1.0
_KNOWN: Final = (
    "lateness_ms", "work_ms", "intake", "measurements", "failures", "publications", "journal", "pipelines",
)  # fmt: skip
_IN_TITLE: Final = ("run", "site", "version", "uptime_s", "devices", "ticks", "overload")
_UNKNOWN: Final = "unknown"

Key = Annotated[
    Path | None, typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub beside.")
]


def status(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="The engine's control port.")] = (
        "tcp://127.0.0.1:5573"
    ),
    *,
    watch: Annotated[bool, typer.Option("--watch", help="Ask every second, until interrupted.")] = False,
    key: Key = None,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, metavar="S", help="How long to wait.")] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: an object, or with --watch one a line.")] = False,
) -> None:
    """Show how an engine is doing: ticks and how late they are, what comes in, what goes out, what fails."""
    with Control(address, keys=own_keys(key), timeout_s=timeout) as control:
        if not watch:
            told = control.status()
            if as_json:
                print_json(told)
            else:
                stdout().print(render(told))
            return
        try:
            if as_json:
                for told in _every_second(control):
                    print_json_line(told)
            else:
                with Live(console=stdout(), auto_refresh=False) as live:
                    for told in _every_second(control):
                        live.update(render(told), refresh=True)
        except KeyboardInterrupt:
            return


def own_keys(key: Path | None) -> Keys | None:
    """Read a client's key and, beside it, the engine's public one; None without a key."""
    return None if key is None else Keys.read(key, key.parent / "engine.pub")


def render(told: Any) -> RenderableType:
    """Return the answer to ``status`` as people read it; what is missing is shown as unknown."""
    if not isinstance(told, Mapping):
        return Text(f"The engine answered {told!r:.200}, which is no status.")
    if "error" in told:
        return Text(str(told["error"]), style="red")
    table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1))
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for name in (*_KNOWN, *(key for key in told if key not in _KNOWN and key not in _IN_TITLE)):
        table.add_row(name.replace("_", " ").removesuffix(" ms"), _value(name, told.get(name)))
    overload = told.get("overload")
    health = Text(f"overload: {overload}", style="red") if overload else Text("keeps up", style="green")
    return Group(Text(_title(told), style="bold"), health, table)


def _every_second(control: Control) -> Iterator[Any]:
    """Ask now and every second; that nobody answers is told in place of an answer."""
    due_s = time.monotonic()
    while True:
        try:
            yield control.status()
        except (NoAnswerError, ClientError) as error:
            yield {"error": str(error)}
        due_s = max(due_s + _PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due_s - time.monotonic()))


def _title(told: Mapping[str, Any]) -> str:
    uptime_s = told.get("uptime_s")
    up = _duration(uptime_s) if isinstance(uptime_s, int | float) else _UNKNOWN
    site, run = told.get("site", _UNKNOWN), told.get("run", _UNKNOWN)
    devices, ticks = (_count(told.get(name)) for name in ("devices", "ticks"))
    return f"{site}, run {run}, up {up}: {devices} devices, {ticks} ticks"


def _value(name: str, value: Any) -> str:
    if value is None:
        return _UNKNOWN
    if name == "pipelines" and isinstance(value, list):
        return ", ".join(_pipeline(one) for one in value) or "none"
    if name == "comparison" and isinstance(value, Mapping):
        return "\n".join(_contestant(pipeline, found) for pipeline, found in value.items()) or "none"
    if isinstance(value, Mapping):
        times = name.endswith("_ms")
        shown = [
            f"{key.replace('_', ' ')} {_count(one)}{' ms' if times and isinstance(one, float) else ''}"
            for key, one in value.items()
            if times or one not in (0, "", None)
        ]
        return ", ".join(shown) or "none"
    if isinstance(value, list):
        return "\n".join(map(str, value)) or "none"
    return _count(value)


def _pipeline(one: Any) -> str:
    if not isinstance(one, Mapping):
        return str(one)
    notes = [note for note in ("primary" if one.get("primary") else "", one.get("state", "")) if note]
    return f"{one.get('name', _UNKNOWN)} ({', '.join(notes)})" if notes else str(one.get("name", _UNKNOWN))


def _count(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {None: _UNKNOWN, True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return f"{value:.1f}"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if isinstance(value, Mapping):
        return "(" + ", ".join(f"{key} {_count(one)}" for key, one in value.items()) + ")"
    return str(value)


def _duration(seconds: float) -> str:
    minutes, s = divmod(int(seconds), 60)
    hours, m = divmod(minutes, 60)
    days, h = divmod(hours, 24)
    parts = [(days, "d"), (h, "h"), (m, "min"), (s, "s")]
    first = next((i for i, (n, _) in enumerate(parts) if n), len(parts) - 1)
    return " ".join(f"{n} {unit}" for n, unit in parts[first : first + 2])


def _contestant(name: str, found: Mapping[str, Any]) -> str:
    """Return how a pipeline does: its error where there is truth, and how far it is from the baseline."""
    parts = []
    if found.get("waypoints"):
        parts.append(f"error {found['error_m']:.2f} m at {found['waypoints']} waypoints")
    if found.get("difference_m") is not None:
        between = found.get("interval_m")
        sure = (
            f", at any time 95 % {between[0]:+.2f} to {between[1]:+.2f}" if between else ", too few to say how surely"
        )
        parts.append(f"{found['difference_m']:+.2f} m against {found['against']} ({found['walks']} walks{sure})")
    if found.get("innovation_m") is not None:
        parts.append(f"innovation {found['innovation_m']:.2f} m")
    if found.get("apart_m") is not None:
        parts.append(f"{found['apart_m']:.2f} m from {found['against']}")
    return f"{name}: {', '.join(parts) or 'nothing to compare yet'}"
