"""Commands for a running engine: ``tickfix status``, ``tickfix listen`` and ``tickfix control``."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich import box
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, print_json_line, stdout, warn
from tickfix.client import ClientError, Control, Keys, Listener, RequestTimeoutError

_PERIOD_S: Final = 1.0
_FIRST_ROWS: Final = (
    "tick_latency_ms", "round_duration_ms", "intake", "measurements", "failures", "publications", "journal",
    "pipelines",
)  # fmt: skip
_IN_TITLE: Final = ("run", "site", "version", "uptime_s", "devices", "ticks", "overload")
_UNKNOWN: Final = "unknown"

KeyOption = Annotated[
    Path | None, typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub beside.")
]


def status(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="The engine's control port.")] = (
        "tcp://127.0.0.1:5573"
    ),
    *,
    watch: Annotated[bool, typer.Option("--watch", help="Ask every second, until interrupted.")] = False,
    key: KeyOption = None,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, metavar="S", help="How long to wait.")] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: an object, or with --watch one a line.")] = False,
) -> None:
    """Show how an engine is doing: ticks and how late they are, what comes in, what goes out, what fails."""
    with Control(address, keys=read_client_keys(key), timeout_s=timeout) as control:
        if not watch:
            reply = control.status()
            if as_json:
                print_json(reply)
            else:
                stdout().print(render_status(reply))
            return
        try:
            if as_json:
                for reply in _poll_status(control):
                    print_json_line(reply)
            else:
                with Live(console=stdout(), auto_refresh=False) as live:
                    for reply in _poll_status(control):
                        live.update(render_status(reply), refresh=True)
        except KeyboardInterrupt:
            return


def read_client_keys(key: Path | None) -> Keys | None:
    """Read a client's key and, beside it, the engine's public one; None without a key."""
    return None if key is None else Keys.read(key, key.parent / "engine.pub")


def render_status(reply: Any) -> RenderableType:
    """Return the answer to ``status`` as people read it; what is missing is shown as unknown."""
    if not isinstance(reply, Mapping):
        return Text(f"The engine answered {reply!r:.200}, which is no status.")
    if "error" in reply:
        return Text(str(reply["error"]), style="red")
    table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1))
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for name in (*_FIRST_ROWS, *(key for key in reply if key not in _FIRST_ROWS and key not in _IN_TITLE)):
        table.add_row(name.replace("_", " ").removesuffix(" ms"), _format_field(name, reply.get(name)))
    overload = reply.get("overload")
    health = Text(f"overload: {overload}", style="red") if overload else Text("keeps up", style="green")
    return Group(Text(_title(reply), style="bold"), health, table)


def _poll_status(control: Control) -> Iterator[Any]:
    """Ask now and every second; that nobody answers is told in place of an answer."""
    due_s = time.monotonic()
    while True:
        try:
            yield control.status()
        except (RequestTimeoutError, ClientError) as error:
            yield {"error": str(error)}
        due_s = max(due_s + _PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due_s - time.monotonic()))


def _title(reply: Mapping[str, Any]) -> str:
    uptime_s = reply.get("uptime_s")
    up = _format_duration(uptime_s) if isinstance(uptime_s, int | float) else _UNKNOWN
    site, run = reply.get("site", _UNKNOWN), reply.get("run", _UNKNOWN)
    devices, ticks = (_format_value(reply.get(name)) for name in ("devices", "ticks"))
    return f"{site}, run {run}, up {up}: {devices} devices, {ticks} ticks"


def _format_field(name: str, value: Any) -> str:
    if value is None:
        return _UNKNOWN
    if name == "pipelines" and isinstance(value, list):
        return ", ".join(_format_pipeline(one) for one in value) or "none"
    if name == "comparison" and isinstance(value, Mapping):
        return "\n".join(_format_comparison(pipeline, figures) for pipeline, figures in value.items()) or "none"
    if isinstance(value, Mapping):
        times = name.endswith("_ms")
        shown = [
            f"{key.replace('_', ' ')} {_format_value(one)}{' ms' if times and isinstance(one, float) else ''}"
            for key, one in value.items()
            if times or one not in (0, "", None)
        ]
        return ", ".join(shown) or "none"
    if isinstance(value, list):
        return "\n".join(map(str, value)) or "none"
    return _format_value(value)


def _format_pipeline(one: Any) -> str:
    if not isinstance(one, Mapping):
        return str(one)
    notes = [note for note in ("primary" if one.get("primary") else "", one.get("state", "")) if note]
    return f"{one.get('name', _UNKNOWN)} ({', '.join(notes)})" if notes else str(one.get("name", _UNKNOWN))


def _format_value(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {None: _UNKNOWN, True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return f"{value:.1f}"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if isinstance(value, Mapping):
        return "(" + ", ".join(f"{key} {_format_value(one)}" for key, one in value.items()) + ")"
    return str(value)


def _format_duration(seconds: float) -> str:
    minutes, s = divmod(int(seconds), 60)
    hours, m = divmod(minutes, 60)
    days, h = divmod(hours, 24)
    parts = [(days, "d"), (h, "h"), (m, "min"), (s, "s")]
    first = next((i for i, (n, _) in enumerate(parts) if n), len(parts) - 1)
    return " ".join(f"{n} {unit}" for n, unit in parts[first : first + 2])


def _format_comparison(name: str, figures: Mapping[str, Any]) -> str:
    """Return how a pipeline does: its error where there is truth, and how far it is from the baseline."""
    parts = []
    if figures.get("waypoints"):
        parts.append(f"error {figures['error_m']:.2f} m at {figures['waypoints']} waypoints")
    if figures.get("difference_m") is not None:
        between = figures.get("interval_m")
        sure = (
            f", at any time 95 % {between[0]:+.2f} to {between[1]:+.2f}" if between else ", too few to say how surely"
        )
        parts.append(f"{figures['difference_m']:+.2f} m against {figures['baseline']} ({figures['walks']} walks{sure})")
    if figures.get("innovation_m") is not None:
        parts.append(f"innovation {figures['innovation_m']:.2f} m")
    if figures.get("divergence_m") is not None:
        parts.append(f"{figures['divergence_m']:.2f} m from {figures['baseline']}")
    return f"{name}: {', '.join(parts) or 'nothing to compare yet'}"


_HEARTBEAT_TIMEOUT_S: Final = 3.0


def listen(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="The engine's positions port.")] = (
        "tcp://127.0.0.1:5572"
    ),
    *,
    topic: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="PREFIX", help="Such as estimate/SITE/FLOOR/ or device/SITE/DEVICE/; several."),
    ] = None,
    count: Annotated[int, typer.Option("--count", min=0, metavar="N", help="Stop after N estimates; 0: never.")] = 0,
    timeout: Annotated[
        float, typer.Option("--timeout", min=0.0, metavar="S", help="Fail after S seconds without one; 0: never.")
    ] = 0.0,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="FILE", help="Own NAME.key; engine.pub beside it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")] = False,
) -> None:
    """Print estimates as they come, and what was missed: gaps in the numbers, heartbeats that did not come."""
    report = print_json_line if as_json else _warn_of_loss
    listener = Listener(
        address,
        topic or ["estimate/"],
        keys=read_client_keys(key),
        on_gap=lambda site, device, pipeline, missed: report(
            {"type": "gap", "site": site, "device": device, "pipeline": pipeline, "missed": missed}
        ),
        on_heartbeat_timeout=lambda heartbeat_timeout_s: report(
            {"type": "heartbeat_timeout", "elapsed_s": heartbeat_timeout_s}
        ),
        on_new_run=lambda run: report({"type": "run", "run": run}),
        heartbeat_timeout_s=_HEARTBEAT_TIMEOUT_S,
        timeout_s=timeout or None,
    )
    show: Callable[[dict[str, Any]], None] = print_json_line if as_json else _print_estimate
    received = 0
    with listener:
        try:
            for estimate in listener:
                show(estimate)
                received += 1
                if received == count:
                    break
        except KeyboardInterrupt:
            pass
    missed = f", {listener.missed} missed" if listener.missed else ""
    sys.stderr.write(f"tickfix: {received} estimates heard{missed}\n")
    if count and received < count:
        raise typer.Exit(1)


def _print_estimate(estimate: dict[str, Any]) -> None:
    belief = estimate.get("belief")
    where = "no position"
    if isinstance(belief, dict):
        (x_m, y_m), ((xx, _), (_, yy)) = belief["xy"], belief["covariance"]
        where = f"{belief['floor']} {x_m:8.2f} {y_m:8.2f} m ± {math.sqrt(xx + yy):.1f} m"
    revision = f" revision {estimate['revision']}" if estimate.get("revision") else ""
    names = f"{estimate['device']} {estimate['pipeline']} tick {estimate['tick']}{revision}"
    sys.stdout.write(f"{names}: {where} {estimate['status']}\n")
    sys.stdout.flush()


def _warn_of_loss(what: dict[str, Any]) -> None:
    match what:
        case {"type": "gap", "device": device, "pipeline": pipeline, "missed": missed}:
            warn(f"{missed} estimates of {device} by {pipeline} were missed")
        case {"type": "heartbeat_timeout", "elapsed_s": heartbeat_timeout_s}:
            warn(f"nothing was heard for {heartbeat_timeout_s:.1f} s, not even a heartbeat")
        case {"type": "run", "run": run}:
            warn(f"the engine restarted: run {run}")


class ControlAction(StrEnum):
    """What an engine can be told."""

    STOP = "stop"
    DRAIN = "drain"
    PRIMARY = "primary"


def control(
    action: Annotated[ControlAction, typer.Argument(help="stop: now, to be resumed; drain: settle every track first.")],
    pipeline: Annotated[str, typer.Argument(metavar="[PIPELINE]", help="The one to publish, for primary.")] = "",
    *,
    at: Annotated[
        str, typer.Option("--at", metavar="ADDRESS", help="The engine's control port.")
    ] = "tcp://127.0.0.1:5573",
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub lies beside it."),
    ] = None,
) -> None:
    """Tell a running engine what to do; what it decides is in its journal."""
    if (action is ControlAction.PRIMARY) != bool(pipeline):
        raise ConfigError("control", f"{action} {pipeline}".strip(), "stop, drain, or primary PIPELINE")
    with Control(at, keys=read_client_keys(key), timeout_s=30.0) as engine:
        args = {"pipeline": pipeline} if pipeline else {}
        stdout().print(engine.request(action.value, **args), soft_wrap=True)
