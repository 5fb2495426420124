"""``tickfix locate``: the fingerprint stage as a process of its own."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError
from tickfix.cli.output import registry, stdout
from tickfix.cli.status import own_keys
from tickfix.cli.survey import ConfigFile
from tickfix.config import build, load
from tickfix.drivers.senders.fixes import LocatingService
from tickfix.drivers.surveying import context_of
from tickfix.site.folder import load as load_site


def locate(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="Folder that `tickfix survey` made.")],
    *,
    feed: Annotated[
        str, typer.Option("--from", metavar="ADDRESS", help="The engine's feed, where scans come from.")
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
    found = registry()
    settings = load(config, found)
    chosen = settings.only([pipeline]).pipelines if pipeline else settings.pipelines
    surveyed = load_site(site)
    with_fingerprint = [p for p in chosen if p.fingerprint is not None]
    if not with_fingerprint:
        raise ConfigError("locate", "no pipeline with a fingerprint", "one that has one, chosen by --pipeline NAME")
    (built,) = build(with_fingerprint[-1:], context_of(surveyed), surveyed.models)
    assert built.fingerprint is not None  # noqa: S101 - chosen for it
    service = LocatingService(built.fingerprint, feed, to, keys=own_keys(key), tell=_tell)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: service.stop())
    console = stdout()
    console.print(f"locating with {built.fingerprint.label}: scans from {feed}, fixes to {to}", soft_wrap=True)
    sys.stdout.flush()
    service.serve()
    console.print(", ".join(f"{count} {what}" for what, count in sorted(service.counts.items())) or "no scans")


def _tell(text: str) -> None:
    sys.stderr.write(f"tickfix: {text}\n")
