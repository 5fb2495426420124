"""Finding plugins, checking what they offer, and leaving out what is broken, each by name and with the fix.

Plugins are taken in the order of distribution, entry-point name and value, tickfix's own first: what a run finds does
not depend on how things were installed. A plugin is identified by these three, since two distributions may use the same
entry-point name. Whatever a plugin prints while it is imported or registers goes to stderr: stdout belongs to results.
"""

from __future__ import annotations

import contextlib
import difflib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, Final

import pluggy

from tickfix.api import hooks
from tickfix.api.algorithms import KINDS
from tickfix.api.errors import PluginError
from tickfix.api.hooks import check_algorithm_class
from tickfix.api.sources import Source
from tickfix.observers import OBSERVER_HOOKS, Observers, hook_manager

_OWN_DISTRIBUTION: Final = "tickfix"


@dataclass(frozen=True, slots=True)
class Offer:
    """A class that a plugin offers, checked.

    Attributes:
        cls: the class; built as its kind requires.
        plugin: name of the entry point that brought it.
        distribution, version: of the installed package it came from.
        value: of the entry point: the module.
    """

    kind: str
    name: str
    cls: type[Any]
    plugin: str
    distribution: str
    version: str
    value: str = ""

    @property
    def label(self) -> str:
        """``kind:name``, as the command line calls it."""
        return f"{self.kind}:{self.name}"

    @property
    def origin(self) -> str:
        """The plugin it came from, as messages name it."""
        return _plugin_label(self.plugin, self.value, self.distribution, self.version)


@dataclass(frozen=True, slots=True)
class DeclaredSource:
    """A kind of measurement that a plugin declares, and which installed package it came from."""

    source: Source
    plugin: str
    distribution: str
    version: str
    value: str = ""

    @property
    def origin(self) -> str:
        """The plugin it came from, as messages name it."""
        return _plugin_label(self.plugin, self.value, self.distribution, self.version)


@dataclass(frozen=True, slots=True)
class PluginProblem:
    """Something that had to be left out.

    Attributes:
        plugin, value: name and value of the entry point.
        problem: what was found.
        fix: what to do, a sentence.
        distribution, version: of the installed package, empty where it is not known.
    """

    plugin: str
    problem: str
    fix: str
    value: str = ""
    distribution: str = ""
    version: str = ""

    def __str__(self) -> str:
        """Return one sentence for the user."""
        label = _plugin_label(self.plugin, self.value, self.distribution, self.version)
        return f"{label}: {self.problem}. {self.fix}"


class Registry:
    """What all plugins together offer, and what was wrong with them.

    Attributes:
        problems: what was left out.
        observers: calls the hooks of plugins that watch runs.
        declared: kinds of measurements that plugins declare, by name.
    """

    def __init__(
        self,
        offers: Iterable[Offer] = (),
        problems: Iterable[PluginProblem] = (),
        observers: Observers | None = None,
        declared: Iterable[DeclaredSource] = (),
    ) -> None:
        """Keep the offers by kind and name."""
        self._offers = {(offer.kind, offer.name): offer for offer in offers}
        self.problems = tuple(problems)
        self.declared = {one.source.name: one for one in sorted(declared, key=lambda one: one.source.name)}
        self.observers = Observers() if observers is None else observers

    def get(self, kind: str, name: str) -> Offer:
        """Return the offer.

        Raises:
            PluginError: when there is none; it names what there is and the nearest spelling.
        """
        try:
            return self._offers[kind, name]
        except KeyError:
            names = [offer.name for offer in self.of_kind(kind)]
            near = difflib.get_close_matches(name, names, 1)
            hint = f"Did you mean {near[0]!r}? " if near else ""
            fix = f"{hint}There are: {', '.join(names) or 'none'}; tickfix plugins lists them"
            raise PluginError(f"{kind}:{name}", "no plugin offers it", fix) from None

    def of_kind(self, kind: str) -> tuple[Offer, ...]:
        """Return the offers of one kind by name."""
        return tuple(offer for key, offer in sorted(self._offers.items()) if key[0] == kind)

    @property
    def sources(self) -> Mapping[str, Source]:
        """The kinds of measurements that plugins declare, by name, to check events with."""
        return {name: one.source for name, one in self.declared.items()}

    @property
    def offers(self) -> tuple[Offer, ...]:
        """All offers, by kind in the order of :data:`~tickfix.api.algorithms.KINDS`, then by name."""
        return tuple(offer for kind in KINDS for offer in self.of_kind(kind))


def discover(found: Sequence[EntryPoint] | None = None) -> Registry:
    """Load every plugin that is installed (or the entry points given) and return what they offer."""
    points = entry_points(group=hooks.ENTRY_POINT_GROUP) if found is None else found
    manager = pluggy.PluginManager("tickfix")
    manager.add_hookspecs(hooks)
    offers: dict[tuple[str, str], Offer] = {}
    declared: dict[str, DeclaredSource] = {}
    problems: list[PluginProblem] = []
    modules: dict[str, ModuleType] = {}
    # An entry point that a distribution lists twice is one.
    for key, point in sorted({_discovery_key(point): point for point in points}.items(), key=lambda item: item[0]):
        label = _label(point)
        try:
            with _stdout_to_stderr():
                module = _import(point)
                _check_hooks(manager, point, module)
                known = next((other for other, registered in modules.items() if registered is module), None)
                if known is not None:
                    problem = f"names module {point.value}, which is registered already as {known}"
                    raise PluginError(point.name, problem, "Remove one of the two entry points")  # noqa: TRY301
                classes, sources = _register(label, point, module)
                for cls in classes:
                    _add_offer(cls, point, offers, problems)
                for source in sources:
                    _add_source(source, point, declared, problems)
            modules[label] = module
        except PluginError as error:
            _, distribution, name, value = key
            problems.append(PluginProblem(name, error.problem, error.fix, value, distribution, _distribution(point)[1]))
    # Those that only register are not kept: calling their hooks costs time in every round.
    watching = {label: module for label, module in modules.items() if any(hasattr(module, h) for h in OBSERVER_HOOKS)}
    return Registry(offers.values(), problems, Observers(watching), declared.values())


def _discovery_key(point: EntryPoint) -> tuple[bool, str, str, str]:
    distribution = _distribution(point)[0]
    return (distribution != _OWN_DISTRIBUTION, distribution, point.name, point.value)


def _distribution(point: EntryPoint) -> tuple[str, str]:
    return (point.dist.name, point.dist.version) if point.dist is not None else ("", "")


def _label(point: EntryPoint) -> str:
    return _plugin_label(point.name, point.value, *_distribution(point))


def _plugin_label(name: str, value: str, distribution: str, version: str) -> str:
    """Return how messages name a plugin: ``my-filter = my_filter.plugin (my-filter 0.1)``."""
    entry = f"{name} = {value}" if value and value != name else name
    return f"{entry} ({distribution} {version})" if distribution else entry


def _import(point: EntryPoint) -> Any:
    """Import the plugin's module, which must have been written for this API."""
    try:
        module = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        problem = f"cannot be imported: {_describe(error)}"
        raise PluginError(point.name, problem, f"Mend or uninstall the package that offers {point.value}") from error
    wanted = getattr(module, "TICKFIX_API", hooks.API_VERSION)
    if wanted != hooks.API_VERSION:
        problem = f"asks for tickfix API {wanted!r}, this is {hooks.API_VERSION}"
        newer = isinstance(wanted, int) and wanted > hooks.API_VERSION
        raise PluginError(point.name, problem, "Upgrade tickfix" if newer else "Upgrade the plugin")
    return module


def _register(label: str, point: EntryPoint, module: Any) -> tuple[list[Any], list[Any]]:
    """Register a module with pluggy and return the classes and the sources that its hooks return, empty without one."""
    try:
        manager = hook_manager(module, label)
    except pluggy.PluginValidationError as error:
        problem = " ".join(str(error).split())
        raise PluginError(point.name, problem, "Take no arguments but those of the hook's specification") from error
    return (
        _collect(point, manager, hooks.tickfix_register.__name__, "classes"),
        _collect(point, manager, hooks.tickfix_sources.__name__, "tickfix.api.Source"),
    )


def _collect(point: EntryPoint, manager: pluggy.PluginManager, hook: str, what: str) -> list[Any]:
    try:
        return [one for returned in getattr(manager.hook, hook)() for one in returned]
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        problem = f"{hook} failed: {_describe(error)}"
        raise PluginError(point.name, problem, f"It takes no arguments and returns a list of {what}") from error


def _describe(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        return f"it ended the process (SystemExit: {error.code})"
    return f"{type(error).__name__}: {error}"


@contextlib.contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Send to stderr what is written to stdout meanwhile, also by C code and by child processes."""
    with contextlib.redirect_stdout(sys.stderr), contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # no such descriptors: a notebook, a service
            for stream in (sys.__stdout__, sys.__stderr__):
                if stream is not None:
                    stream.flush()
            kept = os.dup(1)
            stack.callback(os.close, kept)
            os.dup2(2, 1)
            stack.callback(os.dup2, kept, 1)
        yield
        with contextlib.suppress(OSError, ValueError, AttributeError):
            if sys.__stdout__ is not None:
                sys.__stdout__.flush()


def _check_hooks(manager: pluggy.PluginManager, point: EntryPoint, module: Any) -> None:
    specs = [name for name in dir(hooks) if manager.parse_hookspec_opts(hooks, name) is not None]
    marked = {name: opts for name in dir(module) if (opts := manager.parse_hookimpl_opts(module, name)) is not None}
    for name in dir(module):
        if name in specs and name not in marked:
            raise PluginError(point.name, f"function {name} is not marked as a hook", "Put @hookimpl above it")
    for name, opts in marked.items():
        if name not in specs:
            near = difflib.get_close_matches(name, specs, 1, cutoff=0.0)[0]
            raise PluginError(point.name, f"there is no hook {name!r}", f"Rename it to {near!r}")
        if opts["wrapper"] or opts["hookwrapper"]:
            raise PluginError(point.name, f"{name} is a hook wrapper", "Use plain @hookimpl: plugins are independent")
    if not marked:
        fix = "Define @hookimpl def tickfix_register() that returns your classes"
        raise PluginError(point.name, f"module {point.value} has no hook", fix)


def _add_offer(
    cls: Any, point: EntryPoint, offers: dict[tuple[str, str], Offer], problems: list[PluginProblem]
) -> None:
    distribution, version = _distribution(point)
    try:
        check_algorithm_class(cls)
    except ValueError as error:
        fix = "This class is left out, the plugin's others are used"
        problems.append(PluginProblem(point.name, str(error), fix, point.value, distribution, version))
        return
    key = (cls.kind, cls.name)
    if key in offers:
        problem = f"{cls.kind}:{cls.name} is offered already by {offers[key].origin}"
        fix = f"Give {cls.__name__} another name, or uninstall one of the two"
        problems.append(PluginProblem(point.name, problem, fix, point.value, distribution, version))
        return
    offers[key] = Offer(cls.kind, cls.name, cls, point.name, distribution, version, point.value)


def _add_source(
    source: Any, point: EntryPoint, declared: dict[str, DeclaredSource], problems: list[PluginProblem]
) -> None:
    distribution, version = _distribution(point)
    if not isinstance(source, Source):
        problem, fix = f"declares {source!r:.60}, expected a tickfix.api.Source", "Build a Source"
    elif source.name in declared:
        problem = f"source {source.name} is declared already by {declared[source.name].origin}"
        fix = "Give it another name, or uninstall one of the two"
    else:
        declared[source.name] = DeclaredSource(source, point.name, distribution, version, point.value)
        return
    problems.append(PluginProblem(point.name, problem, fix, point.value, distribution, version))
