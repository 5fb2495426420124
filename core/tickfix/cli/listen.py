"""``tickfix listen``: estimates as an engine publishes them."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from tickfix.cli.output import print_json_line, warn
from tickfix.cli.status import own_keys
from tickfix.client import Listener

_SILENCE_S: Final = 3.0


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
    told = print_json_line if as_json else _warn
    listener = Listener(
        address,
        topic or ["estimate/"],
        keys=own_keys(key),
        on_gap=lambda site, device, pipeline, missed: told(
            {"type": "gap", "site": site, "device": device, "pipeline": pipeline, "missed": missed}
        ),
        on_silence=lambda silence_s: told({"type": "silence", "silence_s": silence_s}),
        on_run=lambda run: told({"type": "run", "run": run}),
        silence_s=_SILENCE_S,
        timeout_s=timeout or None,
    )
    show: Callable[[dict[str, Any]], None] = print_json_line if as_json else _print
    heard = 0
    with listener:
        try:
            for estimate in listener:
                show(estimate)
                heard += 1
                if heard == count:
                    break
        except KeyboardInterrupt:
            pass
    missed = f", {listener.missed} missed" if listener.missed else ""
    sys.stderr.write(f"tickfix: {heard} estimates heard{missed}\n")
    if count and heard < count:
        raise typer.Exit(1)


def _print(estimate: dict[str, Any]) -> None:
    belief = estimate.get("belief")
    where = "no position"
    if isinstance(belief, dict):
        (x_m, y_m), ((xx, _), (_, yy)) = belief["xy"], belief["covariance"]
        where = f"{belief['floor']} {x_m:8.2f} {y_m:8.2f} m ± {math.sqrt(xx + yy):.1f} m"
    revision = f" revision {estimate['revision']}" if estimate.get("revision") else ""
    names = f"{estimate['device']} {estimate['pipeline']} tick {estimate['tick']}{revision}"
    sys.stdout.write(f"{names}: {where} {estimate['status']}\n")
    sys.stdout.flush()


def _warn(what: dict[str, Any]) -> None:
    match what:
        case {"type": "gap", "device": device, "pipeline": pipeline, "missed": missed}:
            warn(f"{missed} estimates of {device} by {pipeline} were missed")
        case {"type": "silence", "silence_s": silence_s}:
            warn(f"nothing was heard for {silence_s:.1f} s, not even a heartbeat")
        case {"type": "run", "run": run}:
            warn(f"the engine began anew: run {run}")
