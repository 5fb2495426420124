"""Finding plugins, checking what they offer, and leaving out what is broken, each by name and with the fix.

Plugins are taken in the order of distribution and entry-point names, tickfix's own first: what a run finds does not
depend on how things were installed.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

import pluggy

from tickfix.api import hooks
from tickfix.api.algorithms import KINDS
from tickfix.api.errors import PluginError
from tickfix.api.hooks import check_algorithm_class

_OWN_DISTRIBUTION: Final = "tickfix"


@dataclass(frozen=True, slots=True)
class Offer:
    """A class that a plugin offers, checked.

    Attributes:
        cls: the class; built as its kind says.
        plugin: name of the entry point that brought it.
        distribution, version: of the installed package it came from.
    """

    kind: str
    name: str
    cls: type[Any]
    plugin: str
    distribution: str
    version: str

    @property
    def label(self) -> str:
        """``kind:name``, as the command line calls it."""
        return f"{self.kind}:{self.name}"


@dataclass(frozen=True, slots=True)
class PluginProblem:
    """Something that had to be left out."""

    plugin: str
    problem: str
    fix: str

    def __str__(self) -> str:
        """Return one sentence for the user."""
        return f"{self.plugin}: {self.problem}. {self.fix}"


class Registry:
    """What all plugins together offer, and what was wrong with them."""

    def __init__(self, offers: Iterable[Offer] = (), problems: Iterable[PluginProblem] = ()) -> None:
        """Keep the offers by kind and name."""
        self._offers = {(offer.kind, offer.name): offer for offer in offers}
        self.problems = tuple(problems)

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
    def offers(self) -> tuple[Offer, ...]:
        """All offers, by kind in the order of :data:`~tickfix.api.algorithms.KINDS`, then by name."""
        return tuple(offer for kind in KINDS for offer in self.of_kind(kind))


def discover(found: Sequence[EntryPoint] | None = None) -> Registry:
    """Load every plugin that is installed (or the entry points given) and return what they offer."""
    points = entry_points(group=hooks.ENTRY_POINT_GROUP) if found is None else found
    manager = pluggy.PluginManager("tickfix")
    manager.add_hookspecs(hooks)
    offers: dict[tuple[str, str], Offer] = {}
    problems: list[PluginProblem] = []
    for point in sorted(points, key=_discovery_order):
        try:
            for cls in _import_and_call_hook(manager, point):
                _add_offer(cls, point, offers, problems)
        except PluginError as error:
            problems.append(PluginProblem(error.plugin, error.problem, error.fix))
    return Registry(offers.values(), problems)


def _discovery_order(point: EntryPoint) -> tuple[bool, str, str]:
    distribution = _distribution(point)[0]
    return (distribution != _OWN_DISTRIBUTION, distribution, point.name)


def _distribution(point: EntryPoint) -> tuple[str, str]:
    return (point.dist.name, point.dist.version) if point.dist is not None else ("", "")


def _import_and_call_hook(manager: pluggy.PluginManager, point: EntryPoint) -> Iterable[Any]:
    """Import one plugin and return what its hook returns."""
    try:
        module = point.load()
    except Exception as error:
        problem = f"cannot be imported: {type(error).__name__}: {error}"
        raise PluginError(point.name, problem, f"Mend or uninstall the package that offers {point.value}") from error
    wanted = getattr(module, "TICKFIX_API", hooks.API_VERSION)
    if wanted != hooks.API_VERSION:
        problem = f"asks for tickfix API {wanted!r}, this is {hooks.API_VERSION}"
        newer = isinstance(wanted, int) and wanted > hooks.API_VERSION
        raise PluginError(point.name, problem, "Upgrade tickfix" if newer else "Upgrade the plugin")
    _check_hooks(manager, point, module)
    try:
        manager.register(module, point.name)
        returned = list(module.tickfix_register())
    except Exception as error:
        problem = f"tickfix_register failed: {type(error).__name__}: {error}"
        fix = "It takes no arguments and returns a list of classes"
        raise PluginError(point.name, problem, fix) from error
    return returned


def _check_hooks(manager: pluggy.PluginManager, point: EntryPoint, module: Any) -> None:
    specs = [name for name in dir(hooks) if manager.parse_hookspec_opts(hooks, name) is not None]
    marked = [name for name in dir(module) if manager.parse_hookimpl_opts(module, name) is not None]
    for name in dir(module):
        if name in specs and name not in marked:
            raise PluginError(point.name, f"function {name} is not marked as a hook", "Put @hookimpl above it")
    for name in marked:
        if name not in specs:
            near = difflib.get_close_matches(name, specs, 1, cutoff=0.0)[0]
            raise PluginError(point.name, f"there is no hook {name!r}", f"Rename it to {near!r}")
    if not marked:
        fix = "Define @hookimpl def tickfix_register() that returns your classes"
        raise PluginError(point.name, f"module {point.value} has no hook", fix)


def _add_offer(
    cls: Any, point: EntryPoint, offers: dict[tuple[str, str], Offer], problems: list[PluginProblem]
) -> None:
    try:
        check_algorithm_class(cls)
    except ValueError as error:
        problems.append(PluginProblem(point.name, str(error), "This class is left out, the plugin's others are used"))
        return
    key = (cls.kind, cls.name)
    if key in offers:
        owner = offers[key]
        problem = f"{cls.kind}:{cls.name} is offered already by {owner.plugin} ({owner.distribution} {owner.version})"
        problems.append(
            PluginProblem(point.name, problem, f"Give {cls.__name__} another name, or uninstall one of the two")
        )
        return
    offers[key] = Offer(cls.kind, cls.name, cls, point.name, *_distribution(point))
