"""What an engine keeps up with: `tickfix serve` as a process, simulated phones and a listener on real sockets.

    python benchmarks/live.py [--pipeline NAME ...] [--devices N] [--seconds S] [--workers N] [--journal DIR]

Every phone sends four sensors at 50 Hz in five batches a second and a scan every few seconds, one in twenty of them
1.4 s late. A batch leaves at the instant of its last sample and closes one tick. Latency is from the instant at which
it was due to leave, whether or not the sender or the engine was behind, until the listener has the position; all on one
monotonic clock. Ticks of the first two seconds do not count.

A pipeline is *sustained* when every position came, 99 % of them within one tick, and no message was refused. Without
--devices, one run of 100 phones is followed by shorter ones of more and more, until one is not sustained. Sender,
listener and engine share the machine.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import msgpack
import numpy as np
import zmq
from live_phones import Script, begin_of, due_ns, name_of, script_of, send

from tickfix import config
from tickfix.api import TICK_NS
from tickfix.client import Control
from tickfix.registry import discover
from tickfix.replay.site_survey import survey_and_train
from tickfix.simulation import simulate_demo
from tickfix.site import save_site

PIPELINES = ("kalman", "fusion")
SETTINGS = """
[pipelines.kalman]
pdr         = { use = "steps" }
fingerprint = { use = "wknn" }
filter      = { use = "kalman" }

[pipelines.fusion]
pdr         = { use = "steps" }
fingerprint = { use = "wknn" }
filter      = { use = "fusion-pf", particles = 500 }
map         = { use = "walls" }
"""
DEVICES, MORE = 100, (150, 200, 250, 300, 400, 500, 700, 1000)
SECONDS, SECONDS_MORE = 14.0, 6.0
WARM_UP = 10
PATIENCE_S = 0.5
TICKS_S = 1e9 / TICK_NS


@dataclass(frozen=True)
class Result:
    """What a run showed; times in ms."""

    devices: int
    seconds: float
    latency_ms: np.ndarray
    missing: int
    refused: int
    sender_late_ms: float
    cpu: float
    rss_mb: float
    grown_kb: float
    journal_mb: float
    status: dict[str, Any]

    @property
    def is_sustained(self) -> bool:
        """Whether the engine kept up."""
        return not self.missing and not self.refused and np.percentile(self.latency_ms, 99) < TICK_NS * 1e-6


@contextmanager
def engine(site: Path, settings: Path, journal: Path, pipeline: str) -> Iterator[tuple[subprocess.Popen[str], Any]]:
    """Run ``tickfix serve`` on free ports; yield the process and its addresses."""
    command = [sys.executable, "-m", "tickfix.cli.main", "serve", str(site), "--config", str(settings)]
    command += ["--pipeline", pipeline, "--journal", str(journal), "--no-watchdog", "--json"]
    for port in ("sensors", "positions", "control", "follow-bind"):
        command += [f"--{port}", "tcp://127.0.0.1:*"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own command
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise SystemExit("the engine did not start; what it said is above")
        yield process, json.loads(line)
    finally:
        process.terminate()
        process.communicate()


def run(site: Path, settings: Path, where: Path, pipeline: str, scripts: list[Script], n: int, s: float) -> Result:
    """Let ``n`` phones send for ``s`` seconds."""
    n_batches = round(s * TICKS_S)
    spawn = multiprocessing.get_context("spawn")
    said = spawn.Queue()
    with (
        tempfile.TemporaryDirectory(dir=where) as journal,
        engine(site, settings, Path(journal) / "journal", pipeline) as (process, addresses),
        Control(addresses["control"], timeout_s=60.0) as control,
        zmq.Context() as context,
        context.socket(zmq.SUB) as listener,
    ):
        listener.setsockopt(zmq.RCVHWM, 0)
        listener.subscribe(b"estimate/")
        listener.connect(addresses["positions"])
        control.request("status")
        rss_kb, cpu_s = used_by(process.pid)
        t0_ns = time.monotonic_ns() + 2_500_000_000
        arguments = (addresses["sensors"], scripts, n, n_batches, t0_ns, said)
        sender = spawn.Process(target=send, args=arguments)
        sender.start()
        heard = listen(listener, t0_ns + round((s + PATIENCE_S) * 1e9))
        rss_end_kb, cpu_end_s = used_by(process.pid)
        status = control.request("status")
        sender_late_ns = said.get(timeout=60.0)
        sender.join()
        status["intake"] = control.request("status")["intake"]
        bytes_written = sum(path.stat().st_size for path in Path(journal).rglob("*") if path.is_file())
    latency_ms, missing = latencies(heard, scripts, n, n_batches, t0_ns)
    refused = sum(status["intake"].get(what, 0) for what in ("busy", "throttled", "malformed", "unauthorised"))
    return Result(
        devices=n,
        seconds=s,
        latency_ms=latency_ms,
        missing=missing,
        refused=refused,
        sender_late_ms=sender_late_ns * 1e-6,
        cpu=(cpu_end_s - cpu_s) / s,
        rss_mb=rss_end_kb / 1024,
        grown_kb=(rss_end_kb - rss_kb) / n,
        journal_mb=bytes_written / 1e6,
        status=status,
    )


def listen(listener: Any, until_ns: int) -> list[tuple[int, bytes]]:
    """Return what came and when, until the time is up."""
    heard: list[tuple[int, bytes]] = []
    while (left_ns := until_ns - time.monotonic_ns()) > 0:
        if listener.poll(1 + left_ns // 1_000_000):
            body = listener.recv_multipart()[-1]
            heard.append((time.monotonic_ns(), body))
    return heard


def latencies(
    heard: list[tuple[int, bytes]], scripts: list[Script], n: int, n_batches: int, t0_ns: int
) -> tuple[np.ndarray, int]:
    """Return the latencies in ms of ticks after the warm-up, and how many of those ticks never came."""
    numbers = {name_of(d).decode(): d for d in range(n)}
    found: dict[tuple[int, int], float] = {}
    for heard_ns, body in heard:
        estimate = msgpack.unpackb(body)
        device = numbers[estimate["device"]]
        batch = estimate["tick"] - scripts[device % len(scripts)].first - begin_of(device)
        if WARM_UP <= batch < n_batches:
            found[device, batch] = (heard_ns - due_ns(t0_ns, batch, device, n)) * 1e-6
    return np.array(list(found.values()) or [np.inf]), n * (n_batches - WARM_UP) - len(found)


def used_by(pid: int) -> tuple[int, float]:
    """Return what a process and its workers use: memory, KiB, shared pages once, and processor time, s (Linux)."""
    workers = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    pss_kb, ticks = 0, 0
    for process in (pid, *workers):
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
        pss_kb += int(next(line for line in rollup.splitlines() if line.startswith("Pss:")).split()[1])
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return pss_kb, ticks / os.sysconf("SC_CLK_TCK")


def show(result: Result) -> None:
    """Print what a run showed."""
    p50, p99 = np.percentile(result.latency_ms, [50, 99])
    verdict = "sustained" if result.is_sustained else "NOT sustained"
    counts = f"{result.missing} positions missing, {result.refused} messages refused"
    print(f"  {result.devices} devices for {result.seconds:g} s: {verdict}; {counts}")
    print(f"    last sample to position   p50 {p50:8.1f} ms   p99 {p99:8.1f} ms")
    for name, key in (("tick lateness", "tick_latency_ms"), ("work a round", "round_duration_ms")):
        spread = result.status[key]
        line = f"p50 {spread['p50']:8.1f} ms   p99 {spread['p99']:8.1f} ms   max {spread['max']:.1f} ms"
        print(f"    {name:25s} {line}")
    ticks, records = result.status["ticks"], result.status["journal"]["records"]
    spent = 1e6 * result.cpu * result.seconds / max(1, ticks)
    print(f"    processor                 {100 * result.cpu:.0f} % of one core, {spent:.0f} µs a tick, all included")
    print(f"    memory                    {result.grown_kb:.0f} KiB a device, {result.rss_mb:.0f} MiB in all")
    written = f"{records / result.seconds:,.0f} records/s, {result.journal_mb / result.seconds:.1f} MB/s"
    print(f"    journal                   {written}; the sender was {result.sender_late_ms:.0f} ms late at most")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What an engine keeps up with.")
    parser.add_argument("--pipeline", action="append", choices=PIPELINES, help="only this one")
    parser.add_argument("--devices", type=int, help="this many, and no search for the most")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of the first run, at most 60")
    parser.add_argument("--workers", type=int, default=0, help="processes that fold; 0: the engine's own does")
    parser.add_argument("--journal", type=Path, help="folder on the disk that matters")
    chosen = parser.parse_args()
    if not 2 * WARM_UP / TICKS_S <= chosen.seconds <= 60:
        parser.error(f"--seconds: found {chosen.seconds:g}, expected {2 * WARM_UP / TICKS_S:g} to 60")
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"{machine}, load average {os.getloadavg()[0]:.1f} before the start")
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "live.toml"
        settings.write_text(f"{SETTINGS}[live]\nworkers = {chosen.workers}\n")
        pipelines = config.load_config(settings, discover()).pipelines
        world = simulate_demo(seed=0)
        recordings = [walk.recording for walk in world.survey]
        save_site(
            survey_and_train(recordings, world.building.floors, pipelines, name="demo").site, Path(folder) / "site"
        )
        scripts = [script_of(walk.recording) for walk in world.walks]
        for pipeline in chosen.pipeline or PIPELINES:
            print(pipeline)
            arguments = (Path(folder) / "site", settings, chosen.journal, pipeline, scripts)
            result = run(*arguments, chosen.devices or DEVICES, chosen.seconds)
            show(result)
            most = result.devices if result.is_sustained else 0
            for devices in () if chosen.devices or not most else MORE:
                result = run(*arguments, devices, SECONDS_MORE)
                show(result)
                if not result.is_sustained:
                    break
                most = devices
            print(f"  devices sustained at 5 Hz: {most or 'fewer than that'}")


if __name__ == "__main__":
    main()
