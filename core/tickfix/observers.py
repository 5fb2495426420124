"""Calling the observer hooks of plugins, so that one that raises is named, removed and the run goes on.

Nothing else calls these hooks: a driver asks :class:`Observers`, which goes through pluggy.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import Any, Final

import pluggy

from tickfix.api import EpochStart, Estimate, Fix, Overrun, Run, StageFault, hooks

_REGISTRATION_HOOKS: Final = frozenset({hooks.tickfix_register.__name__, hooks.tickfix_sources.__name__})

_LOGGER = logging.getLogger(__name__)

OBSERVER_HOOKS: Final = tuple(
    name for name in vars(hooks) if name.startswith("tickfix_") and name not in _REGISTRATION_HOOKS
)
"""Names of the hooks that report on a run, in the order in which they are specified."""


def hook_manager(plugin: ModuleType | Any, label: str) -> pluggy.PluginManager:
    """Return a pluggy manager with this plugin alone.

    Raises:
        pluggy.PluginValidationError: for a hook whose arguments are not among those specified.
    """
    manager = pluggy.PluginManager("tickfix")
    manager.add_hookspecs(hooks)
    manager.register(plugin, label)
    return manager


class Observers:
    """The plugins that watch a run.

    Args:
        plugins: modules (or any objects with hook functions) by the label that messages name them with.
        log: gets one sentence for each observer that is removed; by default the logger of this module, as an error.
    """

    def __init__(
        self, plugins: Mapping[str, ModuleType | Any] | None = None, log: Callable[[str], None] | None = None
    ) -> None:
        """Register the plugins.

        Raises:
            pluggy.PluginValidationError: for a hook whose arguments are not among those specified.
        """
        self._log = partial(_LOGGER.error, extra={"code": "observer_removed"}) if log is None else log
        # A manager for each: pluggy stops at the first plugin that raises, and would hide the call from the others.
        self._managers = {label: hook_manager(plugin, label) for label, plugin in (plugins or {}).items()}
        self._implemented = self._find_implemented()
        self._epochs: dict[str, int] = {}
        self.removed: list[str] = []

    def __bool__(self) -> bool:
        """Tell whether any plugin observes anything."""
        return bool(self._implemented)

    def wants(self, hook: str) -> bool:
        """Tell whether any plugin implements ``hook``; drivers skip collecting what nobody asked for."""
        return hook in self._implemented

    def run_started(self, run: Run) -> None:
        """Report that a run begins."""
        self._epochs.clear()
        self._call("tickfix_run_started", run=run)

    def estimates(self, run: Run, estimates: Sequence[Estimate]) -> None:
        """Report estimates, and before them the epochs that they show to have begun."""
        if not estimates:
            return
        if self.wants("tickfix_epochs_started"):
            started = list(self._epochs_started(estimates))
            if started:
                self._call("tickfix_epochs_started", run=run, epochs=tuple(started))
        self._call("tickfix_estimates", run=run, estimates=tuple(estimates))

    def fixes(self, run: Run, fixes: Sequence[Fix]) -> None:
        """Report fixes of settled ticks."""
        if fixes:
            self._call("tickfix_fixes", run=run, fixes=tuple(fixes))

    def faults(self, run: Run, faults: Sequence[StageFault]) -> None:
        """Report calls of algorithms that failed."""
        if faults:
            self._call("tickfix_faults", run=run, faults=tuple(faults))

    def overruns(self, run: Run, overruns: Sequence[Overrun]) -> None:
        """Report that the engine fell behind, or caught up."""
        if overruns:
            self._call("tickfix_overruns", run=run, overruns=tuple(overruns))

    def run_ended(self, run: Run, reason: str = "") -> None:
        """Report that a run ends; ``reason`` is the error that ended it, if any."""
        self._call("tickfix_run_ended", run=run, reason=reason)

    def _epochs_started(self, estimates: Iterable[Estimate]) -> Iterable[EpochStart]:
        for estimate in estimates:
            if self._epochs.get(estimate.device, -1) < estimate.epoch:
                self._epochs[estimate.device] = estimate.epoch
                yield EpochStart(device=estimate.device, epoch=estimate.epoch, t_ns=estimate.t_ns)

    def _find_implemented(self) -> frozenset[str]:
        """Return the hooks that some plugin implements; drivers ask for them after every event."""
        hooks_of = [manager.hook for manager in self._managers.values()]
        return frozenset(name for name in OBSERVER_HOOKS if any(getattr(h, name).get_hookimpls() for h in hooks_of))

    def _call(self, hook: str, **arguments: Any) -> None:
        for label, manager in list(self._managers.items()):
            try:
                getattr(manager.hook, hook)(**arguments)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - an observer, even one that exits, must not end the run
                del self._managers[label]
                self._implemented = self._find_implemented()
                self.removed.append(label)
                raised = f"{hook} raised {type(error).__name__}: {error}"
                self._log(f"observer {label}: {raised}. None of its hooks is called again")
