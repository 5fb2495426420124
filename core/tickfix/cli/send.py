"""Commands that send to a running engine.

``tickfix send`` plays recordings or a simulated crowd, ``tickfix locate`` runs the fingerprint stage as a process of
its own.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tickfix.api import ConfigError, ReaderError, Recording
from tickfix.cli.console import print_json, progress, registry, stdout, warn_each
from tickfix.cli.log_output import LogLevel, configure_logging
from tickfix.cli.monitor import read_client_keys
from tickfix.cli.survey import ConfigFile
from tickfix.config import build_pipelines, load_config
from tickfix.replay.recording_files import find_recordings, read_recordings
from tickfix.replay.site_survey import site_context
from tickfix.senders.fix_service import FixService
from tickfix.senders.playback import SendReport
from tickfix.senders.playback import send_recordings as send_walks
from tickfix.site import load_site

_CROWD_SEED = 3
_MAX_REASONS = 3


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
    skip_bye: Annotated[bool, typer.Option("--stay", help="Do not say goodbye when a walk is over.")] = False,
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub beside it."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Play walks to an engine: what is not acknowledged is sent again, until it is."""
    if not walks and not crowd:
        raise ConfigError("send", "nothing to send", "recordings, or --crowd N")
    recordings = _read_recordings(walks or []) | _simulate_crowd(crowd, seed)
    if copies > 1:
        recordings = {f"{name}-{i:04d}": walk for name, walk in recordings.items() for i in range(copies)}
    own = read_client_keys(key)
    with progress() as show:
        sent = send_walks(recordings, to, speed=speed, keys=own, skip_bye=skip_bye, progress=show)
    failed = bool(sent.unknown or sent.refused)
    if as_json:
        print_json(_send_report_json(sent))
        raise typer.Exit(int(failed))
    console = stdout()
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(sent.outcomes.items()))
    console.print(f"{sent.messages} messages of {len(recordings)} devices, {sent.resent} sent again: {outcomes}")
    if sent.unknown:
        why = sent.suspected_cause or f"is an engine running at {to}?"
        console.print(f"{sent.unknown} were not acknowledged: {why}")
    for why, count in sent.refused.most_common(_MAX_REASONS):
        console.print(f"{count} were refused: {why}", soft_wrap=True)
    if own is not None and sent.outcomes["unauthorised"]:
        console.print(
            "What a key may speak for stands in the engine's keys/allowed.toml: `tickfix keys allow --device`."
        )
    if failed:
        raise typer.Exit(1)


def _read_recordings(paths: list[Path]) -> dict[str, Recording]:
    if not paths:
        return {}
    files = find_recordings(paths, registry())
    warn_each(files.problems, "problems of readers")
    read = list(read_recordings(files.sources))
    warn_each(tuple(str(error) for error in read if isinstance(error, ReaderError)), "walks that cannot be read")
    return {walk.name: walk for walk in read if isinstance(walk, Recording)}


def _simulate_crowd(count: int, seed: int) -> dict[str, Recording]:
    if not count:
        return {}
    from tickfix.simulation import demo_building, simulate_walks  # noqa: PLC0415 - slow to import

    rng = np.random.default_rng([seed, _CROWD_SEED])
    people = simulate_walks(demo_building(seed), "F1", rng, count=count)
    return {f"person-{i:03d}": walk.recording for i, walk in enumerate(people, 1)}


def _send_report_json(sent: SendReport) -> dict[str, object]:
    return {
        "messages": sent.messages,
        "resent": sent.resent,
        "outcomes": dict(sorted(sent.outcomes.items())),
        "unknown": sent.unknown,
        "refused": dict(sent.refused.most_common(_MAX_REASONS)),
        "max_lag_s": sent.max_lag_s,
    }


def locate(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="Folder that `tickfix survey` made.")],
    *,
    follow: Annotated[
        str, typer.Option("--from", metavar="ADDRESS", help="The engine's follow port, where scans come from.")
    ] = "tcp://127.0.0.1:5574",
    to: Annotated[
        str, typer.Option("--to", metavar="ADDRESS", help="The engine's sensors port, where fixes go.")
    ] = "tcp://127.0.0.1:5571",
    config: ConfigFile = None,
    pipeline: Annotated[
        str | None, typer.Option("--pipeline", metavar="NAME", help="Take this one's fingerprint; default: the last.")
    ] = None,
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub lies beside it."),
    ] = None,
) -> None:
    """Locate scans beside an engine, which then needs no fingerprint of its own: scans from it, fixes to it."""
    configure_logging(None, LogLevel.INFO)
    plugins = registry()
    settings = load_config(config, plugins)
    chosen = settings.only([pipeline]).pipelines if pipeline else settings.pipelines
    surveyed = load_site(site)
    with_fingerprint = [p for p in chosen if p.fingerprint is not None]
    if not with_fingerprint:
        raise ConfigError("locate", "no pipeline with a fingerprint", "one that has one, chosen by --pipeline NAME")
    (built,) = build_pipelines(with_fingerprint[-1:], site_context(surveyed), surveyed.models)
    assert built.fingerprint is not None  # noqa: S101 - chosen for it
    service = FixService(built.fingerprint, follow, to, keys=read_client_keys(key))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: service.stop())
    console = stdout()
    console.print(f"locating with {built.fingerprint.label}: scans from {follow}, fixes to {to}", soft_wrap=True)
    sys.stdout.flush()
    service.serve()
    console.print(", ".join(f"{count} {what}" for what, count in sorted(service.counts.items())) or "no scans")
