"""``tickfix serve``: an engine that takes sensor data in over ZeroMQ and publishes positions."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from tickfix.api import ConfigError, TickfixError
from tickfix.api.errors import PortError
from tickfix.cli.console import registry
from tickfix.cli.log_output import LogFormat, LogLevel, configure_logging
from tickfix.cli.replay import PipelineNames, override_config
from tickfix.cli.survey import ConfigFile, Seed
from tickfix.config import Config, load_config
from tickfix.journal import JournalError
from tickfix.live.engine import Engine
from tickfix.live.heartbeat import WatchdogHeartbeat
from tickfix.live.protocol import OverrunError, WorkerError
from tickfix.live.recovery import resumable_run
from tickfix.live.serve_options import LiveSettings, ServeOptions
from tickfix.live.startup import require_serving_platform
from tickfix.live.startup import serve as run_engine
from tickfix.live.supervisor import CRASH_SIGNALS, EXIT_CRASHED, EXIT_FINAL, supervise
from tickfix.ports import PortAddresses
from tickfix.registry import Registry

_LOGGER = logging.getLogger(__name__)

_ANY = "tcp://127.0.0.1:*"


def serve(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="Folder that `tickfix survey` made.")],
    *,
    config: ConfigFile = None,
    pipeline: PipelineNames = None,
    journal: Annotated[
        Path | None, typer.Option("--journal", metavar="DIR", help="Keep a journal from which the run repeats.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the journal's newest run.")] = False,
    sensors: Annotated[str | None, typer.Option("--sensors", metavar="ADDRESS", help="Where sensors connect.")] = None,
    positions: Annotated[
        str | None, typer.Option("--positions", metavar="ADDRESS", help="Where listeners connect.")
    ] = None,
    control: Annotated[
        str | None, typer.Option("--control", metavar="ADDRESS", help="Where operators connect.")
    ] = None,
    follow_bind: Annotated[
        str | None, typer.Option("--follow-bind", metavar="ADDRESS", help="Where engines that follow this one connect.")
    ] = None,
    keys: Annotated[
        Path | None, typer.Option("--keys", metavar="DIR", help="Keys that `tickfix keys` made; only they come in.")
    ] = None,
    follow: Annotated[
        str, typer.Option("--follow", metavar="ADDRESS", help="Follow another engine: its --follow-bind address.")
    ] = "",
    follow_key: Annotated[
        Path | None, typer.Option("--follow-key", metavar="FILE", help="Own NAME.key for that; engine.pub beside it.")
    ] = None,
    seed: Seed = None,
    watchdog: Annotated[
        bool, typer.Option("--watchdog/--no-watchdog", help="Restart an engine that hangs or dies.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print what happens as JSON lines.")] = False,
    log_format: Annotated[
        LogFormat | None, typer.Option("--log-format", help="How messages to the operator are written on stderr.")
    ] = None,
    log_level: Annotated[LogLevel, typer.Option("--log-level", help="The least severe messages.")] = LogLevel.INFO,
) -> None:
    """Follow devices live: sensors in and positions out over ZeroMQ, every 200 ms, with a journal if wanted.

    Stop it with Ctrl-C or `tickfix control stop`; after a crash start it again with --resume.
    """
    require_serving_platform()
    configure_logging(log_format, log_level, notices=as_json)
    plugins = registry()
    settings = override_config(load_config(config, plugins), pipeline, seed)
    if follow:  # beside the engine that it follows, which has the usual ports
        settings = _with_ports(settings, dict.fromkeys(("sensors", "positions", "control", "follow"), _ANY))
    given = {"sensors": sensors, "positions": positions, "control": control, "follow": follow_bind}
    given |= {"keys": None if keys is None else str(keys)}
    settings = _with_ports(settings, {name: value for name, value in given.items() if value is not None})
    if resume:
        if journal is None:
            raise ConfigError("--resume", "no --journal", "--journal DIR, from which to go on")
        resumable_run(journal)
    options = ServeOptions(
        site=site, config=settings, journal=journal, resume=resume, follow=follow, follow_key=follow_key
    )

    def engine(what: ServeOptions, heartbeat: WatchdogHeartbeat) -> int:
        return _run_engine(what, plugins, heartbeat, as_json=as_json)

    if watchdog:
        stall_s = settings.section("live", LiveSettings).watchdog_s
        code = supervise(options, engine, stall_s=stall_s)
    else:
        code = engine(options, WatchdogHeartbeat())
    raise typer.Exit(code)


def _run_engine(options: ServeOptions, plugins: Registry, heartbeat: WatchdogHeartbeat, *, as_json: bool) -> int:
    running = False

    def on_started(run: str, addresses: PortAddresses) -> None:
        nonlocal running
        running = True
        names = ("sensors", "positions", "control", "follow")
        shown = {name: getattr(addresses, name) for name in names}
        if as_json:
            _print_json_line({"serving": str(options.site), "run": run} | shown)
            return
        kept = "no journal" if options.journal is None else f"journal {options.journal}"
        sys.stdout.write(f"serving {options.site}, run {run}, {kept}\n")
        sys.stdout.writelines(f"  {name:<10} {address or 'closed'}\n" for name, address in shown.items())
        sys.stdout.flush()

    def on_ended(engine: Engine) -> None:
        report = engine.report()
        if as_json:
            _print_json_line({"ended": report})
            return
        late, work = report["tick_latency_ms"], report["round_duration_ms"]
        sys.stdout.write(
            f"ended after {report['ticks']} ticks; "
            f"lateness p50 {late['p50']:.1f} p99 {late['p99']:.1f} max {late['max']:.1f} ms; "
            f"work a round p50 {work['p50']:.1f} p99 {work['p99']:.1f} max {work['max']:.1f} ms\n"
        )

    def control(engine: Engine) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: engine.stop())

    try:
        run_engine(
            options,
            plugins,
            heartbeat,
            on_started=on_started,
            on_ended=on_ended,
            control=control,
        )
    except (TickfixError, OSError) as error:
        _LOGGER.critical("%s", error, extra={"code": "engine_failed"})
        return _exit_code(error, running=running)
    return 0


def _exit_code(error: TickfixError | OSError, *, running: bool) -> int:
    """Return the exit code by which the supervisor knows what to do next."""
    if isinstance(error, OverrunError):
        return EXIT_FINAL
    if isinstance(error, WorkerError):
        if error.signal in CRASH_SIGNALS:  # what breaks a worker would have broken an engine without workers
            os.kill(os.getpid(), error.signal)
        return EXIT_CRASHED
    # What cannot begin is for people to mend; what breaks while it runs is worth another try.
    return EXIT_CRASHED if running and isinstance(error, PortError | JournalError | OSError) else 2


def _with_ports(settings: Config, given: dict[str, Any]) -> Config:
    table = settings.sections.get("ports", {})
    if not given or not isinstance(table, dict):
        return settings
    return replace(settings, sections={**settings.sections, "ports": {**table, **given}})


def _print_json_line(value: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(value, ensure_ascii=False) + "\n")
    sys.stdout.flush()
