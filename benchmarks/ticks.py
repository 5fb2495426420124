"""What a tick costs, by pipeline: a simulated walk through the kernel, each pipeline alone.

    python benchmarks/ticks.py [CONFIG.toml]

Prints the median over several runs of the processor time per tick, in one process and thread, everything included:
intake, rewinding for late scans, folding, estimates.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tickfix import config
from tickfix.registry import discover
from tickfix.replay.driver import replay_recording
from tickfix.replay.site_survey import site_context, survey_and_train
from tickfix.simulation import simulate_demo

REPEATS = 5


def main() -> None:
    """Measure and print."""
    registry = discover()
    chosen = config.load_config(Path(sys.argv[1]) if len(sys.argv) > 1 else None, registry)
    world = simulate_demo(seed=0)
    recordings = [walk.recording for walk in world.survey]
    site = survey_and_train(recordings, world.building.floors, chosen.pipelines, name="demo").site
    walk = world.walks[0].recording
    print(f"one device, one thread, {platform.machine()}, Python {platform.python_version()}")
    for pipeline in chosen.pipelines:
        built = config.build_pipelines([pipeline], site_context(site), site.models)
        taken = []
        for _ in range(REPEATS):
            begun = time.process_time()
            ticks = len(replay_recording(walk, built).settled[pipeline.name])
            taken.append((time.process_time() - begun) / ticks)
        print(f"  {pipeline.name:16s} {1e6 * statistics.median(taken):8.0f} µs a tick, {ticks} ticks")


if __name__ == "__main__":
    main()
