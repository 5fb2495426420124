"""The hooks of tickfix, all of them.

A plugin is a module that the entry-point group ``tickfix.plugins`` names. tickfix imports it once, at start-up, and
calls its hooks through pluggy. There are two groups:

- *Registration*: ``tickfix_register`` offers algorithms, which are ordinary classes
  (:mod:`tickfix.api.algorithms`), and ``tickfix_sources`` declares kinds of measurements.
- *Observers*: all other hooks report on a run, in batches. They return nothing, and whatever they are handed is
  immutable, so no estimate depends on them. A hook may take fewer arguments than it is offered. They are called in the
  thread that runs the engine's loop and delay it by as long as they take: hand slow work to a thread of your own. An
  observer that raises is named in the log, once, and none of its hooks is called again; the run goes on. Where a
  replay spreads walks over several processes, each process calls the hooks for its own walks.

No result depends on the order in which plugins are called: they are taken in the order of their distribution and
entry-point names, tickfix's own first.

A module may declare which interface it was written for, ``TICKFIX_API = 1``; one that declares another than
:data:`API_VERSION` is reported and left out.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import pluggy

from tickfix.api.algorithms import KINDS
from tickfix.api.events import Fix
from tickfix.api.run_events import EpochStart, Overrun, Run, StageFault
from tickfix.api.sources import Source
from tickfix.api.values import Estimate

API_VERSION: Final = 1
"""Changes when a plugin that worked would no longer do so."""

ENTRY_POINT_GROUP: Final = "tickfix.plugins"

hookspec = pluggy.HookspecMarker("tickfix")
hookimpl = pluggy.HookimplMarker("tickfix")
"""Mark a function of your plugin module as a hook: ``@hookimpl`` above ``def tickfix_register(): …``."""


@hookspec
def tickfix_register() -> Sequence[type[Any]]:  # type: ignore[empty-body]
    """Offer algorithms, readers and sinks.

    Called once, when tickfix starts. Return the classes; each declares its ``kind`` (``"pdr"``,
    ``"fingerprint"``, ``"filter"``, ``"map"``, ``"reader"``, ``"sink"``) and ``name``, by which pipelines choose it.
    A name that another plugin already offers for the same kind is reported, and that class left out.

    Since API version 1.
    """


@hookspec
def tickfix_sources() -> Sequence[Source]:  # type: ignore[empty-body]
    """Declare kinds of measurements: further sensors, and scans with columns of their own.

    Called once, when tickfix starts. ``tickfix plugins`` lists them, and events of a declared name are checked where
    they come in: samples must have as many columns, scans the same columns. Undeclared kinds are carried
    unchecked. A name that another plugin declares already is reported, and that declaration left out.

    Since API version 1.
    """


@hookspec
def tickfix_run_started(run: Run) -> None:
    """A run begins.

    Called once per run, before any other observer hook of it: by a replay for each recording, by a live engine when its
    ports are open and it has recovered what its journal holds.

    Args:
        run: the same value in every later call of this run.

    Since API version 1.
    """


@hookspec
def tickfix_epochs_started(run: Run, epochs: Sequence[EpochStart]) -> None:
    """Devices were located for the first time, or for the first time since their clocks started again.

    Called before ``tickfix_estimates`` with the epoch's first estimate.

    Args:
        run: which run.
        epochs: in the order of their first estimates, never empty.

    Since API version 1.
    """


@hookspec
def tickfix_estimates(run: Run, estimates: Sequence[Estimate]) -> None:
    """Ticks were closed, or revised after late events.

    Called by a replay after each event that closed or revised a tick, by a live engine once per round, after the round
    was journaled and its estimates were published. All pipelines are included, also those that are not published.

    Args:
        run: which run.
        estimates: revision 0 for ticks that closed, higher ones for revisions; of a device in the order of ticks within
            each of the two, never empty.

    Since API version 1.
    """


@hookspec
def tickfix_fixes(run: Run, fixes: Sequence[Fix]) -> None:
    """Fingerprints located scans, in ticks that can no longer change.

    Called when the ticks of the fixes settle, one horizon after they closed. Stages shared by several pipelines report
    each fix once; fixes computed by other processes are not reported.

    Args:
        run: which run.
        fixes: in the order of ticks for each device, ``source`` names the fingerprint; never empty.

    Since API version 1.
    """


@hookspec
def tickfix_faults(run: Run, faults: Sequence[StageFault]) -> None:
    """Calls of algorithms failed.

    Called after the batch in which they failed; a tick that is computed again may fail, and be reported, again.

    Args:
        run: which run.
        faults: in the order in which they happened, never empty.

    Since API version 1.
    """


@hookspec
def tickfix_overruns(run: Run, overruns: Sequence[Overrun]) -> None:
    """A live engine fell behind, or caught up; never called in a replay, which has no deadline.

    Args:
        run: which run.
        overruns: in their order, never empty.

    Since API version 1.
    """


@hookspec
def tickfix_run_ended(run: Run, reason: str) -> None:
    """A run ends, whether it is complete or failed.

    Called once for every run that started, after all other hooks of it, unless the process is killed.

    Args:
        run: which run.
        reason: empty for a run that is complete or was stopped; otherwise the error that ended it.

    Since API version 1.
    """


_NAME_PATTERN: Final = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_REQUIRED_METHODS: Final[Mapping[str, Mapping[str, tuple[str, ...]]]] = MappingProxyType(
    {
        "pdr": {"start": (), "step": ("state", "samples")},
        "fingerprint": {"start": (), "step": ("state", "window")},
        "filter": {
            "start": ("prior", "rng"),
            "step": ("state", "motion", "observations", "rng"),
            "estimate": ("state",),
        },
        "map": {"contains": ("xy",), "crosses": ("a", "b"), "nearest_free": ("xy",), "snap": ("previous", "xy")},
        "reader": {"recordings": ("path",), "read": ("path",), "floor": ("path",)},
        "sink": {"write": ("estimate",), "close": ()},
    }
)


def check_algorithm_class(cls: Any) -> None:
    """Check that a class is an algorithm, reader or sink that tickfix can use.

    Raises:
        ValueError: with the problem and what is expected.
    """
    if not isinstance(cls, type):
        raise ValueError(f"offers {cls!r:.60}, expected a class")  # noqa: TRY004 - one kind of error for all checks
    kind, name = getattr(cls, "kind", None), getattr(cls, "name", None)
    if kind not in KINDS:
        raise ValueError(f"class {cls.__name__} has kind {kind!r}, expected one of {', '.join(KINDS)}")
    if not isinstance(name, str) or not _NAME_PATTERN.fullmatch(name):
        raise ValueError(f"class {cls.__name__} has name {name!r}, expected lower-case words joined by hyphens")
    missing = sorted(getattr(cls, "__abstractmethods__", ())) or [
        m for m in _REQUIRED_METHODS[kind] if not hasattr(cls, m)
    ]
    if missing:
        raise ValueError(f"class {cls.__name__} does not define {', '.join(missing)}, which a {kind} needs")
    for method, names in _REQUIRED_METHODS[kind].items():
        _check_signature(cls, method, names)
    if kind == "filter" and hasattr(cls, "smooth"):
        _check_signature(cls, "smooth", ("states",))
        if not hasattr(cls, "lag_s"):
            raise ValueError(f"class {cls.__name__} defines smooth without lag_s, expected an attribute or property")
    if kind in ("pdr", "fingerprint", "filter", "map"):
        _check_params(cls)
    if kind in ("pdr", "fingerprint", "filter") and not dataclasses.is_dataclass(getattr(cls, "State", None)):
        raise ValueError(f"class {cls.__name__} names no State, expected the frozen dataclass of its states")


def _check_signature(cls: type[Any], method: str, names: tuple[str, ...]) -> None:
    function: Callable[..., Any] = getattr(cls, method)
    try:
        inspect.signature(function).bind(None, *names)
    except TypeError:
        found = ", ".join(list(inspect.signature(function).parameters)[1:])
        wanted = ", ".join(names)
        raise ValueError(f"{cls.__name__}.{method} takes ({found}), expected ({wanted})") from None


def _check_params(cls: type[Any]) -> None:
    params = getattr(cls, "Params", None)
    if not (isinstance(params, type) and dataclasses.is_dataclass(params)):
        raise ValueError(f"class {cls.__name__} has Params {params!r}, expected a frozen dataclass")
    bare = [
        f.name
        for f in dataclasses.fields(params)
        if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    if bare:
        raise ValueError(f"{cls.__name__}.Params gives {', '.join(bare)} no default, every parameter needs one")
