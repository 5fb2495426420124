"""The interfaces of the four kinds of algorithms; :mod:`tickfix.api.bases` has bases for their usual shapes.

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

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tickfix.api.events import MotionSamples
from tickfix.api.parameters import Preset
from tickfix.api.site import Context, Survey
from tickfix.api.values import Belief, Motion, Observation, Prior, Readings, Report, Window

Trained: TypeAlias = Mapping[str, NDArray[Any]]
Rng: TypeAlias = np.random.Generator
Train: TypeAlias = Callable[[Any, Survey, Rng], Trained]
"""The optional static method ``train(params, survey, rng)``: learn from the survey, return named arrays."""

KINDS: tuple[str, ...] = ("pdr", "fingerprint", "filter", "map", "reader", "sink")


class Algorithm(Protocol):
    """What tickfix asks of a class of any of the four kinds; the bases bring defaults for all but ``name``."""

    kind: ClassVar[str]
    name: ClassVar[str]
    source: ClassVar[str]
    Params: ClassVar[type[Any]]
    presets: ClassVar[Mapping[str, Preset]]

    def __init__(self, params: Any, context: Context, trained: Trained | None) -> None: ...


class Pdr(Protocol):
    """Dead reckoning: folds the samples of a tick into motion."""

    def start(self) -> Any:
        """Return the state before any sample."""
        ...

    def step(self, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        """Fold the samples of (``samples.t0_ns``, ``samples.t1_ns``]; sensors may be absent, in any tick."""
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


class Filter(Protocol):
    """Folds motion and observations into a belief."""

    def start(self, prior: Prior, rng: Rng) -> Any | None:
        """Return the state at a known start, at a first observation, or with nothing known.

        It is called at the beginning of a track, and, as long as it returns None, again at every tick that brings an
        observation. Until then the estimate says ``initialising``.
        """
        ...

    def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Any, Report]:
        """Fold one tick: its motion, then the observations that belong to it, in their order; often there are none."""
        ...

    def estimate(self, state: Any) -> Belief:
        """Say what the state means. Must not draw random numbers."""
        ...


class FilterOfMany(Filter, Protocol):
    """A filter that may be asked for many devices at once; optional, for filters that are faster so.

    Both methods must say, bit for bit, what ``step`` and ``estimate`` say of each device alone, whichever devices are
    asked for together and in whichever order: no sum may run over devices, nor in an order that depends on how many
    there are, as that of a matrix product does. Where ``step_many`` or ``estimate_many`` raises, the devices are asked
    for one by one, so that only those fail that fail alone.
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
        """Say what each state means."""
        ...
