"""What all kinds of algorithms must keep, as checks with names; and the guarded call through which every check
goes: it forbids clocks and global random number generators, and turns what is raised into a failed check."""

from __future__ import annotations

import dataclasses
import os
import random
import re
import sys
import time
import typing
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, ClassVar, TypeVar
from unittest.mock import patch

import msgspec
import numpy as np

from tickfix.api import Context, TrainedModel, pack, unpack
from tickfix.api.hooks import check_algorithm_class
from tickfix.kernel.stages import has_nan
from tickfix.testing import world

_CLOCK_FUNCTIONS = ("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time")
_FORBIDDEN_FUNCTIONS: tuple[tuple[Any, str, tuple[str, ...]], ...] = (
    (time, "time", (*_CLOCK_FUNCTIONS, "sleep")),
    (uuid, "uuid", ("uuid1", "uuid4")),
    (os, "os", ("urandom",)),
    (random, "random", ("random", "uniform", "gauss", "randint", "choice", "shuffle", "seed")),
    (
        np.random,
        "numpy.random",
        ("rand", "randn", "random", "normal", "uniform", "choice", "randint", "standard_normal", "seed", "shuffle"),
    ),
)


class ForbiddenCallError(Exception):
    """An algorithm asked the world for something that a pure function may not ask for."""


@contextmanager
def forbid_outside_calls() -> Iterator[None]:
    """Let every call to a clock, or to a source of random numbers other than the one given, raise."""
    with ExitStack() as stack:
        for module, label, names in _FORBIDDEN_FUNCTIONS:
            for name in names:
                stack.enter_context(patch.object(module, name, _raising(f"{label}.{name}")))
        stack.enter_context(patch.object(np.random, "default_rng", _seeded_only(np.random.default_rng)))
        yield


def forbidden_names(cls: type[Any]) -> list[str]:
    """Return the names that a module imported, as ``from time import …``: :func:`forbid_outside_calls` misses those."""
    module = sys.modules.get(cls.__module__)
    known = {
        id(getattr(source, name)): f"{label}.{name}" for source, label, names in _FORBIDDEN_FUNCTIONS for name in names
    }
    values = [] if module is None else list(vars(module).values())
    return sorted({known[id(value)] for value in values if id(value) in known})


def _raising(name: str) -> Callable[..., Any]:
    def refuse(*_: Any, **__: Any) -> Any:
        raise ForbiddenCallError(name)

    return refuse


def _seeded_only(default_rng: Callable[..., Any]) -> Callable[..., Any]:
    def make(seed: Any = None) -> Any:
        if seed is None:
            raise ForbiddenCallError("numpy.random.default_rng()")
        return default_rng(seed)

    return make


T = TypeVar("T")


class ContractError(AssertionError):
    """A check that failed; its text names what was found and what to change."""


def require(condition: object, message: str) -> None:
    """Fail with ``message`` unless ``condition`` holds."""
    if not condition:
        raise ContractError(message)


def require_step_pair(returned: Any, kind: type[T]) -> tuple[Any, T]:
    """Return what a ``step`` returned: the next state, and a ``kind``.

    Raises:
        ContractError: for anything else.
    """
    if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[1], kind)):
        raise ContractError(f"step returned {type(returned).__name__}, expected (state, {kind.__name__})")
    pair: tuple[Any, T] = returned
    return pair


@contextmanager
def as_contract_error(what: str) -> Iterator[None]:
    """Raise any error as a ContractError that names the call."""
    try:
        yield
    except ContractError:
        raise
    except ForbiddenCallError as error:
        raise ContractError(
            f"{what} called {error}. Take times from the data and numbers from the rng given"
        ) from error
    except ValueError as error:
        if "read-only" in str(error):
            raise ContractError(f"{what} writes into an array it was given. Make a copy, and change that") from error
        raise ContractError(f"{what} raised ValueError: {error}") from error
    except Exception as error:
        raise ContractError(f"{what} raised {type(error).__name__}: {error}") from error


@contextmanager
def pure_call(what: str) -> Iterator[None]:
    """As :func:`as_contract_error`; clocks, threads and global random generators raise inside it."""
    before = np.random.get_state()[1].tobytes()  # type: ignore[index]  # noqa: NPY002 - the very thing
    with as_contract_error(what), forbid_outside_calls():
        yield
    after = np.random.get_state()[1].tobytes()  # type: ignore[index]  # noqa: NPY002
    require(before == after, f"{what} drew from numpy's global generator. Draw from the rng given")


_UNIT_SUFFIX = re.compile(r"_(m|s|ns|ms|rad|deg|hz|dbm|db|mps|hpa|ut)$")


class AlgorithmContract:
    """What every algorithm must keep. Use the contract of your kind, which adds to it.

    Set in the subclass:
        algorithm: your class.
        params: parameters that differ from the defaults, for instance fewer particles, so that tests are fast.
        trained: what your ``train`` would have learnt, where the algorithm cannot do without.
    """

    algorithm: ClassVar[type[Any]]
    params: ClassVar[Mapping[str, Any]] = {}
    trained: ClassVar[TrainedModel | None] = None

    def make(self, context: Context | None = None) -> Any:
        """Build the algorithm for the kit's world."""
        context = self.context() if context is None else context
        with as_contract_error(f"{self.algorithm.__name__}(params, context, trained)"):
            return self.algorithm(self.algorithm.Params(**self.params), context, self.trained)

    def context(self) -> Context:
        """Return the site that :meth:`make` builds for by default."""
        return world.context()

    def test_the_class_is_accepted_by_registration(self) -> None:
        """Tickfix asks the same when it starts; what fails here would be left out there."""
        try:
            check_algorithm_class(self.algorithm)
        except ValueError as error:
            raise ContractError(f"tickfix would leave this class out: {error}") from error

    def test_the_class_says_what_it_does(self) -> None:
        """``tickfix plugins`` prints the first line of the docstring."""
        doc = vars(self.algorithm).get("__doc__")
        name = self.algorithm.__name__
        require(doc and doc.strip(), f"class {name} has no docstring. Say in its first line what the algorithm does")

    def test_every_parameter_is_documented_with_its_unit(self) -> None:
        """``tickfix plugins show`` prints them; a reader must be able to choose a value."""
        for name, meta in self._metas().items():
            where = f"{self.algorithm.__name__}.Params.{name}"
            require(
                meta is not None and meta.description,
                f"{where} is not documented. Write {name}: Annotated[<type>, parameter('what it is')] = <default>",
            )
            extra = (meta.extra or {}) if meta is not None else {}
            require(
                extra.get("unit") or not _UNIT_SUFFIX.search(name),
                f"{where} looks like a quantity and has no unit. Add unit='…' to its parameter()",
            )

    def test_the_default_parameters_are_within_their_own_bounds(self) -> None:
        """A default that its own declaration forbids could not be written into a file."""
        for field in dataclasses.fields(self.algorithm.Params):
            factory = field.default_factory
            self._check_value(field.name, field.default if factory is dataclasses.MISSING else factory(), "default")

    def test_parameters_cannot_be_changed(self) -> None:
        """One set of parameters is shared by all devices."""
        params = self.algorithm.Params.__dataclass_params__
        require(
            params.frozen, f"{self.algorithm.__name__}.Params can be changed. Write @dataclass(frozen=True) above it"
        )

    def test_every_preset_builds_an_algorithm(self) -> None:
        """A preset names parameters that exist, with values that they allow, and names their source."""
        for name, preset in self.algorithm.presets.items():
            where = f"preset '{name}' of {self.algorithm.__name__}"
            require(preset.source, f"{where} has no source. Say which paper or table its values come from")
            known = {field.name for field in dataclasses.fields(self.algorithm.Params)}
            unknown = sorted(set(preset.values) - known)
            require(not unknown, f"{where} sets {', '.join(unknown)}, which Params does not have")
            for key, value in preset.values.items():
                self._check_value(key, value, where)
            with as_contract_error(f"building with {where}"):
                self.algorithm(self.algorithm.Params(**preset.values), self.context(), self.trained)

    def test_nothing_is_imported_that_tells_the_time_or_draws_random_numbers(self) -> None:
        """Results must depend on what was measured only, so that a replay gives the same bits."""
        found = forbidden_names(self.algorithm)
        module = self.algorithm.__module__
        require(not found, f"module {module} imports {', '.join(found)}. Take times from the data and numbers from rng")

    def test_training_gives_arrays_that_the_algorithm_can_be_built_with(self) -> None:
        """Asked only of an algorithm with a ``train``: named arrays without objects, the same from the same survey."""
        train: Callable[..., TrainedModel] | None = getattr(self.algorithm, "train", None)
        if train is None:
            return
        params, survey = self.algorithm.Params(**self.params), world.survey()
        with pure_call("train"):
            first, second = (train(params, survey, world.rng(9)) for _ in range(2))
        for name, array in first.items():
            what = f"train returned {name!r}"
            require(isinstance(array, np.ndarray), f"{what} as {type(array).__name__}. Return arrays: np.array(value)")
            require(
                array.dtype.kind in "biufSU", f"{what} of dtype {array.dtype}. Models hold numbers or text, no objects"
            )
            same = name in second and array.tobytes() == second[name].tobytes()
            require(same, f"{what}, another one each time. Draw from the rng given only")
        with as_contract_error("building with what train returned"):
            self.algorithm(params, self.context(), first)

    def _metas(self) -> dict[str, msgspec.Meta | None]:
        hints = typing.get_type_hints(self.algorithm.Params, include_extras=True)
        metas: dict[str, msgspec.Meta | None] = {}
        for field in dataclasses.fields(self.algorithm.Params):
            found = [m for m in getattr(hints[field.name], "__metadata__", ()) if isinstance(m, msgspec.Meta)]
            metas[field.name] = found[0] if found else None
        return metas

    def _check_value(self, name: str, value: Any, whose: str) -> None:
        hint = typing.get_type_hints(self.algorithm.Params, include_extras=True)[name]
        try:
            msgspec.convert(value, hint)
        except msgspec.ValidationError as error:
            raise ContractError(f"{whose}: {name} = {value!r} is not allowed by its declaration ({error})") from error


class StateContract(AlgorithmContract):
    """What every algorithm with a state must keep besides."""

    def states(self) -> Iterator[Any]:
        """Yield states that the algorithm passes through on a walk."""
        raise NotImplementedError

    def test_states_are_frozen_dataclasses(self) -> None:
        """The kernel goes back to old states when something comes late: they must still be what they were."""
        state_type = self.algorithm.State
        name = f"{self.algorithm.__name__}.State ({state_type.__name__})"
        require(dataclasses.is_dataclass(state_type), f"{name} is no dataclass. Write @dataclass(frozen=True) above it")
        frozen: bool = state_type.__dataclass_params__.frozen
        require(frozen, f"{name} can be changed. Write @dataclass(frozen=True) above it and return a new one instead")

    def test_states_are_of_the_type_that_the_class_names(self) -> None:
        """The kernel refuses any other, since it could not unpack it."""
        wanted = self.algorithm.State
        for state in self.states():
            found = type(state).__name__
            require(isinstance(state, wanted), f"returned a state of type {found}, expected State = {wanted.__name__}")

    def test_states_survive_packing_and_unpacking(self) -> None:
        """States go to disk and to other machines: arrays, numbers, strings, tuples and frozen dataclasses of these."""
        for state in self.states():
            try:
                data = pack(state)
                again = pack(unpack(data, self.algorithm.State))
            except (TypeError, ValueError, NameError) as error:
                raise ContractError(
                    f"a state cannot be packed and unpacked: {error}. Annotate the fields of State with the types they "
                    "hold; use tuples for lists, and keep what never changes in the algorithm, not in its state"
                ) from error
            require(
                data == again, "a state is another one after packing and unpacking: two of its fields hold one array?"
            )

    def test_states_hold_no_nan(self) -> None:
        """The kernel rejects such a state, and the estimate has status ``failed``."""
        for n, state in enumerate(self.states()):
            require(
                not has_nan(state), f"the state after {n} steps holds NaN. Guard the division or root it comes from"
            )

    def test_a_state_does_not_grow_without_end(self) -> None:
        """A walk may last a day; the kernel keeps many states of it."""
        sizes = [len(pack(state)) for state in self.states()]
        early, late = max(sizes[: len(sizes) // 2 + 1]), sizes[-1]
        message = (
            f"a state grew from {early} to {late} bytes over {len(sizes)} steps. Keep what is needed, not the history"
        )
        require(late <= 1.5 * early + 256, message)
