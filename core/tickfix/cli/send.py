"""``tickfix send``: recordings, or a simulated crowd, played to an engine as phones would send them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tickfix.api import ConfigError, ReaderError, Recording
from tickfix.cli.output import print_json, progress, registry, stdout, warn_of
from tickfix.cli.status import own_keys
from tickfix.drivers.recordings import find, read_all
from tickfix.drivers.senders.recordings import Sent
from tickfix.drivers.senders.recordings import send as send_walks

_CROWD_SEED = 3
_SHOWN = 3


def send(
    walks: Annotated[
        list[Path] | None, typer.Argument(metavar="[WALK…]", help="Recordings, or folders of them.")
    ] = None,
    *,
    to: Annotated[str, typer.Option("--to", metavar="ADDRESS", help="The engine's sensors port.")],
    speed: Annotated[
        float, typer.Option("--speed", min=0.0, metavar="N", help="Times faster than logged; 0: as fast as it goes.")
    ] = 1.0,
    crowd: Annotated[
        int, typer.Option("--crowd", min=0, metavar="N", help="Send N simulated people through the demo's building.")
    ] = 0,
    copies: Annotated[
        int, typer.Option("--copies", min=1, metavar="N", help="Send each walk as N devices, side by side.")
    ] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Of the demo's building and crowd.")] = 0,
    stay: Annotated[bool, typer.Option("--stay", help="Do not say goodbye when a walk is over.")] = False,
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub beside it."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Play walks to an engine: what is not acknowledged is sent again, until it is."""
    if not walks and not crowd:
        raise ConfigError("send", "nothing to send", "recordings, or --crowd N")
    recordings = _recorded(walks or []) | _simulated(crowd, seed)
    if copies > 1:
        recordings = {f"{name}-{i:04d}": walk for name, walk in recordings.items() for i in range(copies)}
    own = own_keys(key)
    with progress() as show:
        sent = send_walks(recordings, to, speed=speed, keys=own, stay=stay, progress=show)
    failed = bool(sent.unknown or sent.refused)
    if as_json:
        print_json(_plain(sent))
        raise typer.Exit(int(failed))
    console = stdout()
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(sent.outcomes.items()))
    console.print(f"{sent.messages} messages of {len(recordings)} devices, {sent.resent} sent again: {outcomes}")
    if sent.unknown:
        why = sent.doubt or f"is an engine running at {to}?"
        console.print(f"{sent.unknown} were not acknowledged: {why}")
    for why, count in sent.refused.most_common(_SHOWN):
        console.print(f"{count} were refused: {why}", soft_wrap=True)
    if own is not None and sent.outcomes["unauthorised"]:
        console.print(
            "What a key may speak for stands in the engine's keys/allowed.toml: `tickfix keys allow --device`."
        )
    if failed:
        raise typer.Exit(1)


def _recorded(paths: list[Path]) -> dict[str, Recording]:
    if not paths:
        return {}
    files = find(paths, registry())
    warn_of(files.problems, "problems of readers")
    read = list(read_all(files.sources))
    warn_of(tuple(str(error) for error in read if isinstance(error, ReaderError)), "walks that cannot be read")
    return {walk.name: walk for walk in read if isinstance(walk, Recording)}


def _simulated(count: int, seed: int) -> dict[str, Recording]:
    if not count:
        return {}
    from tickfix.simulation import demo_building, simulate_walks  # noqa: PLC0415 - slow to import

    rng = np.random.default_rng([seed, _CROWD_SEED])
    people = simulate_walks(demo_building(seed), "F1", rng, count=count)
    return {f"person-{i:03d}": walk.recording for i, walk in enumerate(people, 1)}


def _plain(sent: Sent) -> dict[str, object]:
    return {
        "messages": sent.messages,
        "resent": sent.resent,
        "outcomes": dict(sorted(sent.outcomes.items())),
        "unknown": sent.unknown,
        "refused": dict(sent.refused.most_common(_SHOWN)),
        "behind_s": sent.behind_s,
    }
