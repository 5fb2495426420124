"""An observer: writes one JSON line for every batch of a run into the file that WALK_LOG names."""

import json
import os
from pathlib import Path

from tickfix.api import hookimpl

TICKFIX_API = 1


def _append(run, what, **values):
    path = os.environ.get("WALK_LOG")
    if path:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"run": run.id, "mode": run.mode, "what": what} | values) + "\n")


@hookimpl
def tickfix_run_started(run):
    _append(run, "started", site=run.site, pipelines=list(run.pipelines))


@hookimpl
def tickfix_epochs_started(run, epochs):
    _append(run, "epochs", devices=[epoch.device for epoch in epochs])


@hookimpl
def tickfix_estimates(run, estimates):
    _append(run, "estimates", ticks=[[e.pipeline, e.epoch, e.tick, e.revision, str(e.status)] for e in estimates])


@hookimpl
def tickfix_fixes(run, fixes):
    _append(run, "fixes", sources=[fix.source for fix in fixes])


@hookimpl
def tickfix_faults(run, faults):
    _append(run, "faults", stages=[fault.stage for fault in faults], errors=[fault.error for fault in faults])


@hookimpl
def tickfix_overruns(run, overruns):
    _append(run, "overruns", active=[overrun.active for overrun in overruns])


@hookimpl
def tickfix_run_ended(run, reason):
    _append(run, "ended", reason=reason)
