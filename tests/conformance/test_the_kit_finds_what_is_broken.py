"""Algorithms broken on purpose: each is caught by the check meant for it, with a message that says what to mend."""

from __future__ import annotations

import time
import timeit
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import pytest
import shapely

from tickfix.api import (
    BaseMap,
    BasePdr,
    Belief,
    Context,
    Fix,
    Motion,
    NoParams,
    Observation,
    PredictUpdateFilter,
    Preset,
    Report,
    Stateless,
    StatelessFingerprint,
    displacement,
    parameter,
    wrap_rad,
)
from tickfix.testing import (
    AlgorithmContract,
    ContractError,
    FilterContract,
    FingerprintContract,
    MapContract,
    PdrContract,
    world,
)
from tickfix.testing.filter_batches import check_step_many
from tickfix.testing.world import ReferenceMap


@dataclass(frozen=True)
class GoodParams:
    """Parameters."""

    gain: Annotated[float, parameter("share of the innovation that is believed", gt=0, le=1)] = 0.4
    sigma_m: Annotated[float, parameter("of a fix", unit="m", gt=0)] = 3.0


@dataclass(frozen=True)
class Spot:
    """A state with proper types."""

    floor: str
    xy: np.ndarray[Any, Any]
    variance: float


class Good(PredictUpdateFilter[GoodParams, Spot]):
    """A filter with a constant gain, and nothing wrong with it."""

    name = "good"
    Params = GoodParams
    State = Spot

    def begin(self, fix: Fix, rng: Any) -> Any:
        return Spot(fix.floor, fix.xy, 1.0)

    def predict(self, state: Any, motion: Motion, rng: Any) -> Any:
        heading = 0.0 if motion.heading_rad is None else motion.heading_rad
        way = displacement(motion.distance_m, heading)
        return replace(state, xy=state.xy + way, variance=min(state.variance + 0.05, 1e6))

    def update(self, state: Any, fix: Fix, rng: Any) -> Any:
        gain = self.params.gain
        xy = state.xy + gain * (fix.xy - state.xy)
        return replace(state, floor=fix.floor, xy=xy, variance=max(1.0, (1 - gain) * state.variance)), Report(used=1)

    def estimate(self, state: Any) -> Belief:
        return Belief(floor=state.floor, xy=state.xy, covariance=state.variance * np.eye(2))


class GoodPdr(BasePdr[NoParams]):
    """Says that half a metre is walked in every tick in which the phone shakes."""

    name = "good"

    @dataclass(frozen=True)
    class Way:
        travelled_m: float = 0.0

    State = Way

    def start(self) -> Any:
        return self.Way()

    def step(self, state: Any, samples: Any) -> Any:
        accelerometer = samples.sensors.get("accelerometer")
        shaken = accelerometer is not None and float(np.ptp(accelerometer.values[:, 2])) > 0.5
        way = 0.25 if shaken else 0.0
        moved = self.Way(state.travelled_m + way)
        return moved, Motion(t0_ns=samples.t0_ns, t1_ns=samples.t1_ns, distance_m=way, travelled_m=moved.travelled_m)


class GoodFingerprint(StatelessFingerprint[NoParams]):
    """Stands at the strongest point of the survey that hears best what is heard."""

    name = "good"

    def locate(self, window: Any) -> Any:
        radio_map = self.context.radio_map
        assert radio_map is not None
        index = {name: n for n, name in enumerate(radio_map.transmitters)}
        known = [(index[t], r) for t, r in zip(window.transmitters, window.rssi_dbm, strict=True) if t in index]
        if not known:
            return None
        mean = radio_map.mean_matrix(-100.0)
        heard = np.full(mean.shape[1], -100.0)
        for n, rssi in known:
            heard[n] = rssi
        best = int(np.argmin(((mean - heard) ** 2).sum(axis=1)))
        floor = radio_map.floors[radio_map.point_floor[best]]
        return Fix(t_ns=window.t_ns, floor=floor, xy=radio_map.point_xy[best], covariance=9.0 * np.eye(2))


class GoodMap(BaseMap[NoParams]):
    """The plain map of the kit, as an algorithm."""

    name = "good"

    def __init__(self, params: Any, context: Any, trained: Any = None) -> None:
        super().__init__(params, context, trained)
        self._plain = ReferenceMap(context.floor)

    def contains(self, xy: Any) -> Any:
        return self._plain.contains(xy)

    def crosses(self, a: Any, b: Any) -> Any:
        return self._plain.crosses(a, b)

    def nearest_free(self, xy: Any) -> Any:
        return self._plain.nearest_free(xy)

    def snap(self, previous: Any, xy: Any) -> Any:
        near = None if previous is None else self._plain.nearest_free(previous[None])[0]
        return self._plain.snap(near, xy) if near is None or (near == previous).all() else near


def failing(contract: type[AlgorithmContract], cls: type[Any], **settings: Any) -> dict[str, str]:
    """Return the checks that fail for a class, with what they say."""
    kit = type("TestIt", (contract,), {"algorithm": cls, **settings})()
    found = {}
    for check in sorted(dir(kit)):
        if check.startswith("test_"):
            try:
                getattr(kit, check)()
            except ContractError as error:
                found[check] = str(error)
    return found


@pytest.mark.parametrize(
    ("contract", "cls"),
    [(FilterContract, Good), (PdrContract, GoodPdr), (FingerprintContract, GoodFingerprint), (MapContract, GoodMap)],
)
def test_what_is_good_passes_every_check(contract: type[AlgorithmContract], cls: type[Any]) -> None:
    assert failing(contract, cls) == {}


def changed(base: type[Any], **members: Any) -> type[Any]:
    """Return the class with other members."""
    return type("Broken", (base,), {"__doc__": "Broken on purpose.", "__module__": __name__, **members})


def predicting(change: Callable[[Any, Any, Any, Any], Any]) -> type[Any]:
    """Return the good filter with another ``predict``, which is given what the good one returned."""

    def predict(self: Any, state: Any, motion: Any, rng: Any) -> Any:
        return change(self, Good.predict(self, state, motion, rng), state, rng)

    return changed(Good, predict=predict)


def believing(change: Callable[[Any], Any]) -> type[Any]:
    """Return the good filter with another ``estimate``."""
    return changed(Good, estimate=lambda self, state: change(Good.estimate(self, state)))


def many(
    change: Callable[[list[Any]], list[Any]] = list, believed: Callable[[Any, Any], Any] | None = None
) -> type[Any]:
    """Return the good filter for many devices, with a change to what it returns or to what it believes of each."""

    def step_many(self: Any, states: Any, motions: Any, observations: Any, rngs: Any) -> list[Any]:
        return change([self.step(*each) for each in zip(states, motions, observations, rngs, strict=True)])

    def estimate_many(self: Any, states: Any) -> list[Any]:
        beliefs = [self.estimate(state) for state in states]
        return beliefs if believed is None else [believed(belief, states) for belief in beliefs]

    return changed(Good, step_many=step_many, estimate_many=estimate_many)


def test_a_good_filter_for_many_devices_passes_too() -> None:
    assert failing(FilterContract, many()) == {}


def _swayed(stepped: list[Any]) -> list[Any]:
    """Let each device be moved by a rounding that depends on how many there are."""
    return [(replace(state, xy=state.xy + len(stepped) * 1e-15), report) for state, report in stepped]


def test_a_batch_may_differ_within_its_declared_tolerance_and_no_further() -> None:
    def loose(tolerance: float) -> None:
        check_step_many(changed(many(_swayed), batch_tolerance=tolerance)(Good.Params(), Context(), None), ticks=5)

    loose(1e-9)
    with pytest.raises(ContractError, match="batch_tolerance = 1e-20"):
        loose(1e-20)
    with pytest.raises(ContractError, match=r"batch_tolerance is 2\.0"):
        loose(2.0)


def pdr_together(change: Callable[[list[Any]], list[Any]] = list, **members: Any) -> type[Any]:
    """Return the good pdr for many devices, with a change to what it returns."""

    def step_many(self: Any, states: Any, samples: Any) -> list[Any]:
        return change([self.step(*each) for each in zip(states, samples, strict=True)])

    return changed(GoodPdr, step_many=step_many, **members)


def fingerprint_together(change: Callable[[list[Any]], list[Any]] = list, **members: Any) -> type[Any]:
    """Return the good fingerprint for many devices, with a change to what it returns."""

    def step_many(self: Any, states: Any, windows: Any) -> list[Any]:
        return change([self.step(*each) for each in zip(states, windows, strict=True)])

    return changed(GoodFingerprint, step_many=step_many, **members)


def check_together(contract: type[Any], cls: type[Any]) -> None:
    """Run the kit's check of ``step_many``."""
    type("TestIt", (contract,), {"algorithm": cls})().test_many_devices_at_once_are_stepped_as_each_alone()


def _longer(stepped: list[Any]) -> list[Any]:
    more_m = len(stepped) * 1e-12
    return [(state, replace(motion, distance_m=motion.distance_m + more_m)) for state, motion in stepped]


def _elsewhere(stepped: list[Any]) -> list[Any]:
    def moved(seen: Any) -> Any:
        fix = seen.fix
        return seen if fix is None else replace(seen, fix=replace(fix, xy=fix.xy + len(stepped) * 1e-12))

    return [(state, moved(seen)) for state, seen in stepped]


def _likely(stepped: list[Any]) -> list[Any]:
    return [(s, replace(o, log_likelihood=lambda _, xy: np.full(len(xy), -1.0))) for s, o in stepped]


def test_a_good_pdr_and_a_good_fingerprint_for_many_devices_pass() -> None:
    check_together(PdrContract, pdr_together())
    check_together(FingerprintContract, fingerprint_together())


@pytest.mark.parametrize(
    ("contract", "cls", "message"),
    [
        (PdrContract, pdr_together(_longer), "another motion .* distance_m differs"),
        (PdrContract, pdr_together(lambda stepped: stepped[1:]), "returned 6 results"),
        (FingerprintContract, fingerprint_together(_elsewhere), "another observation .* xy differs"),
        (FingerprintContract, fingerprint_together(_likely), "log_likelihood differs"),
        (FingerprintContract, fingerprint_together(_elsewhere, batch_tolerance=1e-20), "batch_tolerance = 1e-20"),
        (FingerprintContract, fingerprint_together(batch_tolerance=2.0), r"batch_tolerance is 2\.0"),
    ],
)
def test_a_batch_that_differs_from_single_steps_is_found(contract: type[Any], cls: type[Any], message: str) -> None:
    with pytest.raises(ContractError, match=message):
        check_together(contract, cls)


def test_batches_of_a_pdr_and_a_fingerprint_may_differ_within_their_tolerance() -> None:
    check_together(PdrContract, pdr_together(_longer, batch_tolerance=1e-9))
    check_together(FingerprintContract, fingerprint_together(_elsewhere, batch_tolerance=1e-9))


def _write(_: Any, moved: Any, state: Any, rng: Any) -> Any:
    state.xy.flags.writeable = True
    state.xy[:] = moved.xy
    return replace(moved, xy=state.xy)


def _count(self: Any, moved: Any, state: Any, rng: Any) -> Any:
    self.calls = getattr(self, "calls", 0) + 1
    return replace(moved, variance=moved.variance + 1e-3 * self.calls)


@dataclass
class Loose:
    floor: str
    xy: np.ndarray[Any, Any]
    variance: float


@dataclass(frozen=True)
class Listed:
    floor: str
    xy: np.ndarray[Any, Any]
    variance: float
    history: Any = ()


@dataclass(frozen=True)
class BareParams(GoodParams):
    limit_m: float = 3.0


@dataclass(frozen=True)
class UnitlessParams(GoodParams):
    limit_m: Annotated[float, parameter("how far")] = 3.0


@dataclass(frozen=True)
class OutOfBoundsParams(GoodParams):
    share: Annotated[float, parameter("of something", le=1)] = 2.0


@dataclass
class ChangeableParams:
    gain: Annotated[float, parameter("gain")] = 0.4


def _with_state(state: type[Any], **more: Any) -> type[Any]:
    return changed(Good, State=state, begin=lambda self, fix, rng: state(fix.floor, fix.xy, 1.0, **more))


def _training(train: Callable[..., Any]) -> type[Any]:
    return changed(Good, train=staticmethod(train))


BROKEN_FILTERS: dict[str, tuple[type[Any], str, str]] = {
    "misnamed": (changed(Good, name="My Filter"), "accepted_by_registration", "lower-case words"),
    "odd signature": (
        changed(Good, predict=None, step=lambda self, state, motion: None),
        "accepted_by_registration",
        "takes \\(state, motion\\), expected",
    ),
    "undocumented": (changed(Good, __doc__=None), "says_what_it_does", "docstring"),
    "bare parameter": (changed(Good, Params=BareParams), "documented_with_its_unit", "limit_m is not documented"),
    "no unit": (changed(Good, Params=UnitlessParams), "documented_with_its_unit", "limit_m .* no unit"),
    "default out of bounds": (changed(Good, Params=OutOfBoundsParams), "within_their_own_bounds", "share = 2.0"),
    "changeable parameters": (changed(Good, Params=ChangeableParams), "parameters_cannot_be_changed", "frozen=True"),
    "unknown preset": (
        changed(Good, presets=MappingProxyType({"x": Preset("a paper", {"gian": 1.0})})),
        "every_preset_builds",
        "gian, which Params does not have",
    ),
    "preset out of bounds": (
        changed(Good, presets=MappingProxyType({"x": Preset("a paper", {"gain": 7.0})})),
        "every_preset_builds",
        "gain = 7.0",
    ),
    "changeable state": (_with_state(Loose), "states_are_frozen", "Loose"),
    "state of another type": (changed(Good, State=Listed), "of_the_type_that_the_class_names", "Spot, expected State"),
    "state that cannot be packed": (_with_state(Listed, history=[1]), "survive_packing", "found list"),
    "state that grows": (
        changed(
            _with_state(Listed),
            predict=lambda self, state, motion, rng: replace(state, history=(*state.history, *(10 * [0.5]))),
        ),
        "does_not_grow",
        "grew from",
    ),
    "NaN in the state": (
        predicting(lambda self, moved, state, rng: replace(moved, variance=float("nan"))),
        "states_hold_no_nan",
        "NaN",
    ),
    "does not begin": (changed(Good, start=lambda self, prior, rng: None), "begins_at_a_fix", "returned None"),
    "begins elsewhere": (
        changed(Good, begin=lambda self, fix, rng: Spot(fix.floor, np.zeros(2), 1.0)),
        "begins_at_a_fix",
        "m away",
    ),
    "cannot begin with nothing": (
        changed(Good, start=lambda self, prior, rng: self.begin(prior.fix, rng)),
        "begins_or_waits",
        "AttributeError",
    ),
    "asymmetric covariance": (
        believing(lambda b: replace(b, covariance=b.covariance + np.array([[0.0, 1.0], [0.0, 0.0]]))),
        "their_covariances_are_covariances",
        "not symmetric",
    ),
    "indefinite covariance": (
        believing(lambda b: replace(b, covariance=np.array([[1.0, 2.0], [2.0, 1.0]]))),
        "their_covariances_are_covariances",
        "negative eigenvalue",
    ),
    "infinite belief": (
        believing(lambda b: replace(b, xy=b.xy * np.inf)),
        "their_covariances_are_covariances",
        "not finite",
    ),
    "one of two methods for many": (
        changed(Good, estimate_many=lambda self, states: []),
        "many_devices_at_once",
        "estimate_many alone",
    ),
    "devices that sway each other": (many(_swayed), "many_devices_at_once", "another state of device .*: xy differs"),
    "devices in the wrong order": (
        many(lambda stepped: stepped[::-1]),
        "many_devices_at_once",
        "all together, at tick 1",
    ),
    "devices left out": (many(lambda stepped: stepped[:1]), "many_devices_at_once", "of 7 devices returned 1 results"),
    "devices reported otherwise": (
        many(lambda stepped: [(state, Report()) for state, _ in stepped]),
        "many_devices_at_once",
        "another report of device .*: used differs",
    ),
    "devices believed otherwise": (
        many(believed=lambda belief, states: replace(belief, speed_mps=float(len(states)))),
        "many_devices_at_once",
        "another belief of device .*: speed_mps differs",
    ),
    "goes astray": (
        predicting(lambda self, moved, state, rng: replace(moved, xy=moved.xy + 0.5)),
        "follows_a_clean_walk",
        "strays",
    ),
    "hidden state": (predicting(_count), "function_of_its_arguments", "Keep nothing outside"),
    "hidden state of another track": (predicting(_count), "two_tracks_do_not_disturb", "on self"),
    "writes into its state": (predicting(_write), "old_states_stay", "changed the state"),
    "writes into a fix": (
        changed(Good, update=lambda self, state, fix, rng: (fix.xy.__setitem__(0, 0.0), Report())),
        "follows_a_clean_walk",
        "writes into an array it was given",
    ),
    "reads the clock": (
        predicting(lambda self, moved, state, rng: replace(moved, variance=time.time())),
        "randomness_comes_from_the_rng",
        "called time.time",
    ),
    "makes an id": (
        predicting(lambda self, moved, state, rng: replace(moved, floor=str(uuid.uuid4()))),
        "randomness_comes_from_the_rng",
        "called uuid.uuid4",
    ),
    "global dice": (
        predicting(lambda self, moved, state, rng: replace(moved, xy=moved.xy + np.random.normal(0, 0.1, 2))),  # noqa: NPY002
        "randomness_comes_from_the_rng",
        "called numpy.random.normal",
    ),
    "own dice": (
        predicting(lambda self, moved, state, rng: replace(moved, xy=moved.xy + np.random.default_rng().normal())),
        "randomness_comes_from_the_rng",
        "default_rng",
    ),
    "needs a heading": (
        changed(Good, predict=lambda self, state, motion, rng: replace(state, variance=abs(motion.heading_rad) + 1)),
        "survives_motion_without_heading",
        "TypeError",
    ),
    "knows one floor": (
        changed(Good, update=lambda self, state, fix, rng: (replace(state, floor={"F1": "F1"}[fix.floor]), Report())),
        "survives_fixes_on_another_floor",
        "KeyError: 'F2'",
    ),
    "needs a fix": (
        changed(
            Good,
            step=lambda self, s, motion, observations, rng: (s, Report(used=sum(o.fix.t_ns > 0 for o in observations))),
        ),
        "survives_observations_without_a_fix",
        "AttributeError",
    ),
    "never doubts": (
        believing(lambda b: replace(b, covariance=np.eye(2))),
        "uncertainty_grows",
        "Add the noise",
    ),
    "loves the origin": (
        predicting(lambda self, moved, state, rng: replace(moved, xy=np.clip(moved.xy, -30.0, 30.0))),
        "same_walk_elsewhere",
        "compared with a constant",
    ),
    "counts twice": (
        changed(Good, update=lambda self, state, fix, rng: (Good.update(self, state, fix, rng)[0], Report(used=2))),
        "reports_count",
        "2 used",
    ),
    "trains differently": (
        _training(lambda params, survey, rng, calls=[]: {"n": np.array(calls.append(0) or len(calls))}),
        "training_gives_arrays",
        "another one each time",
    ),
    "trains objects": (
        _training(lambda params, survey, rng: {"n": np.array([object()])}),
        "training_gives_arrays",
        "dtype object",
    ),
}


@pytest.mark.parametrize("what", BROKEN_FILTERS)
def test_a_broken_filter_is_caught_by_the_check_meant_for_it(what: str) -> None:
    caught(FilterContract, *BROKEN_FILTERS[what])


def moving(change: Callable[[Any, Any], Any]) -> type[Any]:
    """Return the good pdr with another motion."""

    def step(self: Any, state: Any, samples: Any) -> Any:
        state, motion = GoodPdr.step(self, state, samples)
        return state, change(motion, samples)

    return changed(GoodPdr, step=step)


BROKEN_PDRS: dict[str, tuple[type[Any], str, str]] = {
    "wrong interval": (moving(lambda m, s: replace(m, t0_ns=0)), "motion_covers_the_tick", "the tick is"),
    "negative": (moving(lambda m, s: replace(m, distance_m=-1.0)), "motion_covers_the_tick", "distance_m = -1"),
    "unwrapped": (moving(lambda m, s: replace(m, heading_rad=4.0)), "motion_covers_the_tick", "wrap_rad"),
    "needs a gyroscope": (
        moving(lambda m, s: replace(m, turn_rad=float(s.sensors["gyroscope"].values[0, 0]))),
        "any_sensors_may_be_absent",
        "KeyError",
    ),
    "does not add up": (moving(lambda m, s: replace(m, travelled_m=1.0)), "distances_add_up", "Carry it"),
    "walks in its sleep": (
        moving(lambda m, s: replace(m, distance_m=0.3)),
        "phone_at_rest_goes_nowhere",
        "on a table",
    ),
    "walks too far": (
        moving(lambda m, s: replace(m, travelled_m=100 * m.travelled_m)),
        "a_walk_has_about_its_length",
        "m long",
    ),
    "floating seconds": (
        moving(lambda m, s: replace(m, distance_m=abs(float(wrap_rad(s.t1_ns * 1e-9))))),
        "when_it_happened_does_not_matter",
        "Subtract times",
    ),
    "wrong type": (
        changed(GoodPdr, step=lambda self, state, samples: state),
        "motion_covers",
        r"expected \(state, Motion",
    ),
}


@pytest.mark.parametrize("what", BROKEN_PDRS)
def test_a_broken_pdr_is_caught_by_the_check_meant_for_it(what: str) -> None:
    caught(PdrContract, *BROKEN_PDRS[what])


def locating(change: Callable[[Any, Any], Any]) -> type[Any]:
    """Return the good fingerprint with another fix."""
    return changed(GoodFingerprint, locate=lambda self, window: change(GoodFingerprint.locate(self, window), window))


ANYWHERE = Fix(t_ns=world.T0_NS, floor="F1", xy=np.array([3.0, 3.0]))

BROKEN_FINGERPRINTS: dict[str, tuple[type[Any], str, str]] = {
    "always a fix": (locating(lambda fix, w: fix or ANYWHERE), "without_readings_gives_no_fix", "nothing was heard"),
    "believes strangers": (
        locating(lambda fix, w: ANYWHERE if len(w) else None),
        "unknown_transmitters_give_no",
        "None",
    ),
    "no covariance": (
        locating(lambda fix, w: fix and replace(fix, covariance=np.zeros((2, 2)))),
        "fixes_are_finite",
        "positive definite",
    ),
    "foreign floor": (locating(lambda fix, w: fix and replace(fix, floor="roof")), "fixes_are_finite", "does not have"),
    "elsewhere": (locating(lambda fix, w: fix and replace(fix, xy=fix.xy + 8)), "finds_where_it_stands", "locates_m"),
    "needs many": (
        locating(lambda fix, w: fix and replace(fix, xy=fix.xy / (len(w) - 1))),
        "any_number_of_readings",
        "Guard the division|divide by zero",
    ),
    "wide window": (
        changed(
            GoodFingerprint, window=property(lambda self: replace(StatelessFingerprint.window.fget(self), seconds=300))
        ),
        "window_is_one",
        "≤ 60",
    ),
    "NaN likelihood": (
        changed(
            GoodFingerprint,
            step=lambda self, state, window: (
                state,
                Observation(t_ns=window.t_ns, source="x", log_likelihood=lambda floor, xy: np.full(len(xy), np.nan)),
            ),
        ),
        "likelihood_has_a_number",
        "nan",
    ),
    "wrong type": (
        changed(GoodFingerprint, step=lambda self, state, window: ANYWHERE),
        "fixes_are",
        r"expected \(state",
    ),
    "impure": (
        changed(
            GoodFingerprint,
            locate=lambda self, window: Fix(t_ns=window.t_ns, floor="F1", xy=_count_up(self)),
        ),
        "function_of_its_arguments",
        "outside of the state",
    ),
}


def _count_up(self: Any) -> Any:
    self.calls = getattr(self, "calls", 0) + 1
    return np.array([float(self.calls % 5), 1.0])


@pytest.mark.filterwarnings("ignore:divide by zero|invalid value")
@pytest.mark.parametrize("what", BROKEN_FINGERPRINTS)
def test_a_broken_fingerprint_is_caught_by_the_check_meant_for_it(what: str) -> None:
    caught(FingerprintContract, *BROKEN_FINGERPRINTS[what])


class EndPointMap(GoodMap):
    """Looks at the ends of a move only."""

    def crosses(self, a: Any, b: Any) -> Any:
        return self._plain.contains(a) != self._plain.contains(b)


def _walls_only(self: Any, a: Any, b: Any) -> Any:
    lines = shapely.MultiLineString([w.tolist() for w in self.context.floor.walls])
    ways = [shapely.LineString([p, q]) for p, q in zip(a, b, strict=True)]
    return np.array([way.intersects(lines) for way in ways], dtype=np.bool_)


BROKEN_MAPS: dict[str, tuple[type[Any], str, str]] = {
    "ends only": (EndPointMap, "crossings_are_those_of_the_drawing", "unnoticed"),
    "thin walls": (EndPointMap, "too_thin", "unnoticed"),
    "walls only": (changed(GoodMap, crosses=_walls_only), "crossings_are_those", "unnoticed"),
    "one way": (
        changed(GoodMap, crosses=lambda self, a, b: GoodMap.crosses(self, a, b) & (a[:, 0] < b[:, 0])),
        "crosses_backwards",
        "one direction only",
    ),
    "invents": (
        changed(GoodMap, crosses=lambda self, a, b: self._plain.distance_m(a, b) < 0.3),
        "crossings_are_those",
        "meets no wall",
    ),
    "closed door": (
        changed(GoodMap, crosses=lambda self, a, b: (a[:, 0] < 5) != (b[:, 0] < 5)),
        "door_can_be_passed",
        "door",
    ),
    "moves what is free": (
        changed(GoodMap, nearest_free=lambda self, xy: GoodMap.nearest_free(self, xy) + 1e-9),
        "nearest_free_place",
        "where one can stand",
    ),
    "far away": (
        changed(
            GoodMap,
            nearest_free=lambda self, xy: np.where(self.contains(xy)[:, None], xy, np.array([[2.0, 2.0]])),
        ),
        "nearest_free_place",
        "too far",
    ),
    "forgets obstacles": (
        changed(GoodMap, contains=lambda self, xy: (xy >= 0).all(axis=1) & (xy <= [20, 12]).all(axis=1)),
        "stand_where_the_drawing",
        "contains is wrong",
    ),
    "jumps through walls": (
        changed(GoodMap, snap=lambda self, previous, xy: self.nearest_free(xy[None])[0]),
        "snapping_does_not_pass",
        "other side",
    ),
    "by company": (
        changed(GoodMap, crosses=lambda self, a, b: GoodMap.crosses(self, a, b) & (len(a) > 50)),
        "judged_by_itself",
        "differs for 7 places alone and among 300",
    ),
    "lists": (changed(GoodMap, contains=lambda self, xy: [True] * len(xy)), "shapes_and_types", "expected"),
    "writes": (
        changed(GoodMap, nearest_free=lambda self, xy: (xy.__setitem__(slice(None), 0.0), xy)[1]),
        "shapes_and_types",
        "writes into an array",
    ),
}


@pytest.mark.parametrize("what", BROKEN_MAPS)
def test_a_broken_map_is_caught_by_the_check_meant_for_it(what: str) -> None:
    caught(MapContract, *BROKEN_MAPS[what])


def test_importing_a_clock_by_name_is_noticed() -> None:
    cls = changed(Good, __module__=timeit.__name__)  # which does
    with pytest.raises(ContractError, match=r"imports .*time\.perf_counter"):
        type(
            "TestIt", (FilterContract,), {"algorithm": cls}
        )().test_nothing_is_imported_that_tells_the_time_or_draws_random_numbers()


def caught(contract: type[AlgorithmContract], cls: type[Any], check: str, says: str) -> None:
    """Run the one check meant for what is broken, which must fail and say so."""
    (wanted,) = [name for name in dir(contract) if name.startswith("test_") and check in name]
    with pytest.raises(ContractError, match=says):
        getattr(type("TestIt", (contract,), {"algorithm": cls})(), wanted)()


def test_stateless_is_a_state() -> None:
    assert GoodFingerprint.State is Stateless
