"""Small bases for the usual shapes of algorithms: all but what makes the algorithm is there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, TypeVar

from tickfix.api.algorithms import Rng, Trained
from tickfix.api.arrays import Bools, Floats
from tickfix.api.events import Fix, MotionSamples
from tickfix.api.parameters import NoParams, Preset
from tickfix.api.site import Context
from tickfix.api.values import Belief, Motion, Observation, Prior, Readings, Report, Window

P = TypeVar("P")
S = TypeVar("S")


class _Base(ABC, Generic[P]):
    """What all bases share: the three things an algorithm is built of."""

    kind: ClassVar[str]
    name: ClassVar[str]
    source: ClassVar[str] = ""
    Params: ClassVar[type[Any]] = NoParams
    presets: ClassVar[Mapping[str, Preset]] = {}

    def __init__(self, params: P, context: Context, trained: Trained | None = None) -> None:
        """Keep the three; an algorithm that prepares something extends this."""
        self.params: P = params
        self.context = context
        self.trained = trained


class BasePdr(_Base[P]):
    """Base of dead-reckoning algorithms."""

    kind = "pdr"
    State: ClassVar[type[Any]]

    @abstractmethod
    def start(self) -> Any:
        """Return the state before any sample."""

    @abstractmethod
    def step(self, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        """Fold the samples of a tick."""


class BaseFingerprint(_Base[P]):
    """Base of fingerprints with a state of their own."""

    kind = "fingerprint"
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
        """Return the position of the window, None where its readings do not tell one."""


class BaseFilter(_Base[P]):
    """Base of filters."""

    kind = "filter"
    State: ClassVar[type[Any]]

    @abstractmethod
    def start(self, prior: Prior, rng: Rng) -> Any | None:
        """Return the state at the prior, or None to wait for one that says more."""

    @abstractmethod
    def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Any, Report]:
        """Fold one tick."""

    @abstractmethod
    def estimate(self, state: Any) -> Belief:
        """Say what the state means."""


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
            if observation.fix is not None:
                state, report = self.update(state, observation.fix, rng)
                total = replace(
                    report,
                    used=total.used + report.used,
                    gated=total.gated + report.gated,
                    reasons=total.reasons + report.reasons,
                )
        return state, total

    @abstractmethod
    def begin(self, fix: Fix, rng: Rng) -> S:
        """Return the state at ``fix``."""

    @abstractmethod
    def predict(self, state: S, motion: Motion, rng: Rng) -> S:
        """Move the state through one tick."""

    @abstractmethod
    def update(self, state: S, fix: Fix, rng: Rng) -> tuple[S, Report]:
        """Correct the state by a fix."""


class BaseMap(_Base[P]):
    """Base of floor maps; ``context.floor`` is the floor to map. See :class:`~tickfix.api.site.FloorMap`."""

    kind = "map"

    @abstractmethod
    def contains(self, xy: Floats) -> Bools:
        """Tell for each point whether one can stand there."""

    @abstractmethod
    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each move whether it passes through or touches a wall."""

    @abstractmethod
    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point the nearest place where one can stand."""

    @abstractmethod
    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return a place that the map allows."""
