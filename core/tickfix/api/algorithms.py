"""The interfaces of the four kinds of algorithms; :mod:`tickfix.api.algorithms` has bases for their usual shapes.

Every algorithm is a class built as ``Algorithm(params, context, trained)``:

- ``params`` is an instance of its frozen dataclass ``Params``, checked already; fields are declared as
  ``k: Annotated[int, parameter("neighbours averaged", ge=1)] = 5``;
- ``context`` is the site, see :class:`~tickfix.api.site.Context`;
- ``trained`` holds the arrays its optional ``train`` returned when the site was surveyed, or None.

What folds, folds alike: ``start`` gives a first state, ``step`` a new state from the old one. States are frozen
dataclasses of arrays, scalars, strings, tuples and such dataclasses again; they are values: never change one, return
another. The class names its state type as ``State``, so that states can be packed and unpacked
(:mod:`tickfix.api.packing`). A stage reads no clock and draws no random number but from the ``rng`` it is given.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Protocol, TypeAlias, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tickfix.api.arrays import Bools, Floats
from tickfix.api.events import Fix, MotionSamples
from tickfix.api.site import Context, Survey, Transition
from tickfix.api.values import Belief, Motion, Observation, Prior, Readings, Report, Window

TrainedModel: TypeAlias = Mapping[str, NDArray[Any]]
Rng: TypeAlias = np.random.Generator
TrainFunction: TypeAlias = Callable[[Any, Survey, Rng], TrainedModel]
"""The optional static method ``train(params, survey, rng)``: learn from the survey, return named arrays."""

KINDS: tuple[str, ...] = ("pdr", "fingerprint", "filter", "map", "reader", "sink")


class Algorithm(Protocol):
    """What tickfix asks of a class of any of the four kinds; the bases bring defaults for all but ``name``."""

    kind: ClassVar[str]
    name: ClassVar[str]
    source: ClassVar[str]
    Params: ClassVar[type[Any]]
    presets: ClassVar[Mapping[str, Preset]]

    def __init__(self, params: Any, context: Context, trained: TrainedModel | None) -> None: ...


class Pdr(Protocol):
    """Dead reckoning: folds the samples of a tick into motion."""

    def start(self) -> Any:
        """Return the state before any sample."""
        ...

    def step(self, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        """Fold the samples of (``samples.t0_ns``, ``samples.t1_ns``]; sensors may be absent, in any tick."""
        ...


class BatchPdr(Pdr, Protocol):
    """A pdr that can step many devices in one call; optional, for algorithms that are faster that way.

    ``step_many`` must return, bit for bit, what ``step`` returns for each device alone, for any grouping and order of
    devices, or numbers within the class's ``batch_tolerance``. If it raises, the devices are stepped one by one.
    """

    def step_many(self, states: Sequence[Any], samples: Sequence[MotionSamples]) -> Sequence[tuple[Any, Motion]]:
        """Fold one tick of each device; both are equally long, and so is what is returned, in the same order."""
        ...


class Fingerprint(Protocol):
    """Positioning by signal strengths: turns a window of readings into an observation, once per scan."""

    @property
    def window(self) -> Window:
        """Which readings it wants to see."""
        ...

    def start(self) -> Any:
        """Return the state before any scan."""
        ...

    def step(self, state: Any, window: Readings) -> tuple[Any, Observation]:
        """Fold the newest scan; ``window`` ends with it and may be without readings."""
        ...


class BatchFingerprint(Fingerprint, Protocol):
    """A fingerprint that can step many devices in one call; optional, for algorithms that are faster that way.

    The contract is that of :class:`BatchPdr`. Functions within observations must agree too.
    """

    def step_many(self, states: Sequence[Any], windows: Sequence[Readings]) -> Sequence[tuple[Any, Observation]]:
        """Fold one scan of each device; both are equally long, and so is what is returned, in the same order."""
        ...


class Filter(Protocol):
    """Folds motion and observations into a belief."""

    def start(self, prior: Prior, rng: Rng) -> Any | None:
        """Return the state at a known start, at a first observation, or with nothing known.

        It is called at the beginning of a track, and, as long as it returns None, again at every tick that brings an
        observation. Until then the estimate has status ``initialising``.
        """
        ...

    def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Any, Report]:
        """Fold one tick: its motion, then the observations that belong to it, in their order; often there are none."""
        ...

    def estimate(self, state: Any) -> Belief:
        """Return the belief that the state represents. Must not draw random numbers."""
        ...


class BatchFilter(Filter, Protocol):
    """A filter that can step many devices in one call; optional, for filters that are faster that way.

    Both methods must return, bit for bit, what ``step`` and ``estimate`` return for each device alone, for any grouping
    and order of devices: no sum may run over devices, nor in an order that depends on how many there are, as that of a
    matrix product does. If ``step_many`` or ``estimate_many`` raises, the devices are stepped one by one, so that only
    those fail that fail alone.
    """

    def step_many(
        self,
        states: Sequence[Any],
        motions: Sequence[Motion],
        observations: Sequence[Sequence[Observation]],
        rngs: Sequence[Rng],
    ) -> Sequence[tuple[Any, Report]]:
        """Fold one tick of each device; all four are equally long, and so is what is returned.

        No two of ``rngs`` are the same generator.
        """
        ...

    def estimate_many(self, states: Sequence[Any]) -> Sequence[Belief]:
        """Return the belief that each state represents."""
        ...


class SmoothingFilter(Filter, Protocol):
    """A filter that can correct the belief at a tick from what was measured after it; optional.

    A tick is smoothed once, when neither it nor the ticks within ``lag_s`` after it can change any more: that is, the
    horizon and the lag after it was published. The smoothed belief comes out as a further revision of the estimate and
    stands in the settled track; the belief at revision 0 and the filter's own course remain what they are. The states
    of all ticks in the horizon and the lag are kept in memory for it.
    """

    @property
    def lag_s(self) -> float:
        """How much of the future a smoothed belief takes into account, in seconds: 0 to 60, rounded to whole ticks."""
        ...

    def smooth(self, states: Sequence[Any]) -> Belief:
        """Return the belief at the time of ``states[0]``, given all that ``states`` were computed from.

        Must be pure and draw no random numbers.

        Args:
            states: what ``start`` or ``step`` returned at consecutive ticks, oldest first: at least one, at most the
                ticks of ``lag_s`` and one. There are fewer at the end of a track and before a tick at which the filter
                failed. What the way back needs besides the belief must be in the state, such as the moments predicted
                before the observations of the tick.
        """
        ...


def parameter(
    doc: str,
    *,
    unit: str = "",
    source: str = "",
    trains: bool = False,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    lt: float | None = None,
    formerly: str = "",
) -> msgspec.Meta:
    """Describe a field of ``Params`` inside ``Annotated``.

    Args:
        doc: what it is, in a few words.
        unit: ``"m"``, ``"rad"``, ``"s"`` …, empty for a pure number.
        source: the equation or section it comes from, as ``"[jiang2015] eq. (18)"``.
        trains: whether what ``train`` learns depends on it; such a model serves only the values it was trained with.
        ge, gt, le, lt: the allowed range.
        formerly: the name it had in an earlier release. A file that still uses it is refused with the new name, so that
            an old setting is never dropped silently.
    """
    bounds: dict[str, Any] = {
        name: bound for name, bound in (("ge", ge), ("gt", gt), ("le", le), ("lt", lt)) if bound is not None
    }
    extra = {"unit": unit, "source": source, "trains": trains, "formerly": formerly}
    return msgspec.Meta(description=doc, extra=extra, **bounds)


@dataclass(frozen=True, slots=True)
class Preset:
    """A named set of parameters, usually a paper's: ``filter = { use = "fusion-pf", preset = "jiang2015" }``."""

    source: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class NoParams:
    """The parameters of an algorithm that has none."""


P = TypeVar("P")
S = TypeVar("S")


class _AlgorithmBase(ABC, Generic[P]):
    """What all bases share: the three things an algorithm is built of."""

    kind: ClassVar[str]
    name: ClassVar[str]
    source: ClassVar[str] = ""
    Params: ClassVar[type[Any]] = NoParams
    presets: ClassVar[Mapping[str, Preset]] = {}

    def __init__(self, params: P, context: Context, trained: TrainedModel | None = None) -> None:
        """Keep the three; an algorithm that prepares something extends this."""
        self.params: P = params
        self.context = context
        self.trained = trained


class BasePdr(_AlgorithmBase[P]):
    """Base of dead-reckoning algorithms.

    Attributes:
        batch_tolerance: of ``step_many``, see :class:`BaseFilter`.
    """

    kind = "pdr"
    batch_tolerance: ClassVar[float] = 0.0
    State: ClassVar[type[Any]]

    @abstractmethod
    def start(self) -> Any:
        """Return the state before any sample."""

    @abstractmethod
    def step(self, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        """Fold the samples of a tick."""


class BaseFingerprint(_AlgorithmBase[P]):
    """Base of fingerprints with a state of their own.

    Attributes:
        batch_tolerance: of ``step_many``, see :class:`BaseFilter`.
    """

    kind = "fingerprint"
    batch_tolerance: ClassVar[float] = 0.0
    State: ClassVar[type[Any]]

    @property
    def window(self) -> Window:
        """The default window: everything heard in the last five seconds."""
        return Window()

    @abstractmethod
    def start(self) -> Any:
        """Return the state before any scan."""

    @abstractmethod
    def step(self, state: Any, window: Readings) -> tuple[Any, Observation]:
        """Fold the newest scan."""


@dataclass(frozen=True, slots=True)
class Stateless:
    """The state of an algorithm that keeps none."""


class StatelessFingerprint(BaseFingerprint[P]):
    """Base of fingerprints that need nothing but the window: write ``locate(window) -> Fix | None``."""

    State = Stateless

    def start(self) -> Stateless:
        """Return the empty state."""
        return Stateless()

    def step(self, state: Stateless, window: Readings) -> tuple[Stateless, Observation]:
        """Locate the window."""
        return state, Observation(t_ns=window.t_ns, source=self.name, fix=self.locate(window))

    @abstractmethod
    def locate(self, window: Readings) -> Fix | None:
        """Return the position of the window, None if its readings do not determine one."""


class BaseFilter(_AlgorithmBase[P]):
    """Base of filters.

    Attributes:
        batch_tolerance: by how much numbers of ``step_many`` and ``estimate_many`` may differ from those of each device
            alone, relative to the larger of 1 and the number; 0 means bit for bit. Above 0, matrix products and GPUs
            may be used, but runs repeat only within it; ``tickfix plugins show`` and the journal's manifest show it.
    """

    kind = "filter"
    batch_tolerance: ClassVar[float] = 0.0
    State: ClassVar[type[Any]]

    @abstractmethod
    def start(self, prior: Prior, rng: Rng) -> Any | None:
        """Return the state at the prior, or None to wait for one with a fix."""

    @abstractmethod
    def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Any, Report]:
        """Fold one tick."""

    @abstractmethod
    def estimate(self, state: Any) -> Belief:
        """Return the belief that the state represents."""


class PredictUpdateFilter(BaseFilter[P], Generic[P, S]):
    """Base of filters in two halves: write ``begin``, ``predict``, ``update`` and ``estimate``."""

    def start(self, prior: Prior, rng: Rng) -> S | None:
        """Begin at the prior's fix, wait where there is none."""
        return None if prior.fix is None else self.begin(prior.fix, rng)

    def step(self, state: S, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[S, Report]:
        """Predict once, then update with each observation that has a fix."""
        return self.correct(self.predict(state, motion, rng), observations, rng)

    def correct(self, state: S, observations: Sequence[Observation], rng: Rng) -> tuple[S, Report]:
        """Update a state that is predicted already with each observation that has a fix."""
        total = Report()
        for observation in observations:
            updated = self.observe(state, observation, rng)
            if updated is not None:
                state, report = updated
                total = replace(
                    report,
                    used=total.used + report.used,
                    gated=total.gated + report.gated,
                    reasons=total.reasons + report.reasons,
                )
        return state, total

    def observe(self, state: S, observation: Observation, rng: Rng) -> tuple[S, Report] | None:
        """Correct the state by one observation, None where it tells nothing.

        By default only the fix is used. A filter that can use ``observation.log_likelihood`` overrides this, see
        :func:`tickfix.toolkit.likelihoods.offered_log_likelihood`.
        """
        return None if observation.fix is None else self.update(state, observation.fix, rng)

    @abstractmethod
    def begin(self, fix: Fix, rng: Rng) -> S:
        """Return the state at ``fix``."""

    @abstractmethod
    def predict(self, state: S, motion: Motion, rng: Rng) -> S:
        """Move the state through one tick."""

    @abstractmethod
    def update(self, state: S, fix: Fix, rng: Rng) -> tuple[S, Report]:
        """Correct the state by a fix."""


class BaseMap(_AlgorithmBase[P]):
    """Base of floor maps; ``context.floor`` is the floor to map. See :class:`~tickfix.api.site.FloorMap`."""

    kind = "map"

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """The site's stairs, lifts and escalators that touch this floor; a map that finds its own overrides this."""
        floor = self.context.floor
        return () if floor is None else self.context.transitions_on(floor.name)

    @abstractmethod
    def contains(self, xy: Floats) -> Bools:
        """Return for each point whether one can stand there."""

    @abstractmethod
    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return for each move whether it passes through or touches a wall."""

    @abstractmethod
    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point the nearest place where one can stand."""

    @abstractmethod
    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return a place that the map allows."""
