"""What every fingerprint must keep."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tickfix.api import Observation, Readings, Window, pack, unpack
from tickfix.testing import world
from tickfix.testing.contract import StateContract, as_contract_error, pure_call, require, require_step_pair
from tickfix.testing.stage_batches import check_stage_step_many, comparable_observation, window_inputs

_POSITIONS = [(3.0, 3.0), (10.0, 2.0), (16.5, 6.0), (4.0, 10.0), (10.0, 9.5)]


class FingerprintContract(StateContract):
    """Checks of a fingerprint: ``class TestMine(FingerprintContract): algorithm = Mine``.

    Set in the subclass, where it does not fit:
        locates_m: without noise it finds the places of the kit's world this well, at the median.
    """

    locates_m: float = 4.0

    def states(self) -> Iterator[Any]:
        """Yield the states over some scans."""
        algorithm = self.make()
        state = self._start(algorithm)
        for n in range(40):
            x, y = _POSITIONS[n % len(_POSITIONS)]
            state, _ = self._step(algorithm, state, world.readings("F1", (x, y), t_ns=world.T0_NS + n * 10**9))
            yield state

    def test_the_window_is_one_that_the_kernel_can_give(self) -> None:
        """Up to a minute of readings, of one scan or more, of known sources."""
        with as_contract_error("window"):
            window = self.make().window
        require(isinstance(window, Window), f"window is {type(window).__name__}, expected tickfix.api.Window")
        require(
            0 < window.seconds <= 60,
            f"window.seconds = {window.seconds:g}, must be > 0 and ≤ 60: the kernel keeps no more",
        )
        require(window.scans >= 1, f"window.scans = {window.scans}, must be ≥ 1")
        known = set(window.sources) <= {"wifi", "ble"} and window.sources
        require(known, f"window.sources = {window.sources!r}, expected 'wifi', 'ble' or both")

    def test_it_finds_where_it_stands(self) -> None:
        """Without noise, at places of the survey and between them."""
        errors, wrong = [], []
        for floor in world.floors():
            for xy in _POSITIONS:
                fix = self._observe(world.readings(floor, xy)).fix
                require(fix is not None, f"no fix at {xy} on {floor}, where a dozen transmitters are heard")
                if fix is not None and fix.floor == floor:
                    errors.append(math.dist(fix.xy, xy))
                else:
                    wrong.append(floor)
        require(len(wrong) <= len(errors), f"{len(wrong)} of {len(wrong) + len(errors)} fixes are on the wrong floor")
        median = float(np.median(errors))
        require(
            median <= self.locates_m,
            f"errs by {median:.1f} m at the median, allowed are locates_m = {self.locates_m:g}",
        )

    def test_fixes_are_finite_with_a_covariance(self) -> None:
        """On a floor of the site, and no surer than anybody can be."""
        for n in range(60):
            x, y = _POSITIONS[n % len(_POSITIONS)]
            window = world.readings("F1", (x, y), t_ns=world.T0_NS + n * 10**9, noise_db=8.0)
            _check_observation(self._observe(window), window)

    def test_a_window_without_readings_gives_no_fix(self) -> None:
        """A scan may hear nothing at all."""
        observation = self._observe(world.make_readings(world.T0_NS, [], [], []))
        require(observation.fix is None, "a window without readings gave a fix. Return None: nothing was heard")

    def test_unknown_transmitters_give_no_fix(self) -> None:
        """Another building's, or hotspots that somebody carries."""
        names = [f"unknown {n}" for n in range(20)]
        observation = self._observe(world.make_readings(world.T0_NS, names, [-50.0] * 20, [0.0] * 20))
        require(observation.fix is None, "transmitters that the survey never heard gave a fix. Return None")

    def test_unknown_transmitters_beside_known_ones_do_no_harm(self) -> None:
        """Most of what a phone hears may be new since the survey."""
        heard = world.rssi_at("F1", np.array([10.0, 2.0]))
        names = [*heard, *(f"unknown {n}" for n in range(40))]
        window = world.make_readings(world.T0_NS, names, [*heard.values(), *([-40.0] * 40)], [0.0] * len(names))
        _check_observation(self._observe(window), window)

    def test_it_survives_strange_strengths(self) -> None:
        """From a phone that lies on the transmitter to values below any receiver's noise."""
        names = list(world.rssi_at("F1", np.array([10.0, 2.0])))
        for value in (0.0, 20.0, -30.0, -99.9, -100.0, -100.1, -127.0, -200.0):
            window = world.make_readings(world.T0_NS, names, [value] * len(names), [0.0] * len(names))
            _check_observation(self._observe(window), window)

    def test_it_survives_any_number_of_readings(self) -> None:
        """One transmitter, two, all of them."""
        heard = world.rssi_at("F1", np.array([10.0, 2.0]))
        for n in range(1, len(heard) + 1):
            names = list(heard)[:n]
            window = world.make_readings(world.T0_NS, names, [heard[name] for name in names], [0.0] * n)
            _check_observation(self._observe(window), window)

    def test_it_survives_one_transmitter_heard_several_times(self) -> None:
        """A window over several scans holds each reading with its own age."""
        heard = world.rssi_at("F1", np.array([10.0, 2.0]))
        names = [name for name in heard for _ in range(3)]
        rssi = [heard[name] - 3.0 * (n % 3) for n, name in enumerate(names)]
        ages = [0.7 * (n % 3) for n in range(len(names))]
        window = world.make_readings(world.T0_NS, names, rssi, ages)
        _check_observation(self._observe(window), window)

    def test_a_likelihood_has_a_number_for_every_place(self) -> None:
        """Asked only where it is offered: (n,) without NaN, greater here than at the other end of the floor."""
        window = world.readings("F1", (3.0, 3.0))
        likelihood = self._observe(window).log_likelihood
        if likelihood is None:
            return
        xy = np.array([[3.0, 3.0], [18.0, 10.0], [1.0, 11.0]])
        xy.flags.writeable = False
        with pure_call("log_likelihood"):
            values, none = likelihood("F1", xy), likelihood("F1", xy[:0])
        require(values.shape == (3,) and none.shape == (0,), f"log_likelihood of 3 places has shape {values.shape}")
        require(not np.isnan(values).any() and (values < np.inf).all(), f"log_likelihood is {values.tolist()}")
        require(values[0] > values[1], "log_likelihood thinks the far end of the floor likelier than the place itself")

    def test_samples_are_places_of_the_site(self) -> None:
        """Asked only where they are offered: n places with their floors, the same from the same rng."""
        sample = self._observe(world.readings("F1", (3.0, 3.0))).sample
        if sample is None:
            return
        with pure_call("sample"):
            (floors, xy), (_, again) = (sample(50, world.rng(5)) for _ in range(2))
        require(
            len(floors) == 50 and xy.shape == (50, 2), f"sample(50, rng) gave {len(floors)} floors, {xy.shape} places"
        )
        require(set(floors) <= set(world.floors()), f"sample gave floors {sorted(set(floors))}")
        require(
            np.isfinite(xy).all() and xy.tobytes() == again.tobytes(), "sample must be finite and draw from rng only"
        )

    def test_a_step_is_a_function_of_its_arguments(self) -> None:
        """The same state and window give the same, again and in another instance; the state stays as it was."""
        one, two = self.make(), self.make()
        state = self._start(one)
        for n in range(20):
            x, y = _POSITIONS[n % len(_POSITIONS)]
            window, before = world.readings("F1", (x, y), t_ns=world.T0_NS + n * 10**9, noise_db=4.0), pack(state)
            results = [self._step(a, state, window) for a in (one, one, two)]
            said = {(pack(s), _comparable(o)) for s, o in results}
            require(len(said) == 1, "step gave two results for the same arguments. Keep nothing outside of the state")
            require(pack(state) == before, "step changed the state it was given. Return a new state")
            again = self._step(one, unpack(before, self.algorithm.State), window)
            require((pack(again[0]), _comparable(again[1])) in said, "an unpacked state goes on differently")
            state = results[0][0]

    def test_many_devices_at_once_are_stepped_as_each_alone(self) -> None:
        """Only for a fingerprint with ``step_many``: the grouping of devices changes no bits."""
        if hasattr(self.algorithm, "step_many"):
            check_stage_step_many(self.make(), window_inputs(12), Observation, comparable_observation)

    def _observe(self, window: Readings) -> Observation:
        algorithm = self.make()
        return self._step(algorithm, self._start(algorithm), window)[1]

    @staticmethod
    def _start(algorithm: Any) -> Any:
        with pure_call("start"):
            return algorithm.start()

    @staticmethod
    def _step(algorithm: Any, state: Any, window: Readings) -> tuple[Any, Observation]:
        with pure_call(f"step with {len(window)} readings"):
            returned = algorithm.step(state, window)
        return require_step_pair(returned, Observation)


def _comparable(observation: Observation) -> tuple[Any, ...]:
    fix = observation.fix
    return () if fix is None else (fix.t_ns, fix.floor, fix.xy.tobytes(), fix.covariance.tobytes())


def _check_observation(observation: Observation, window: Readings) -> None:
    require(
        observation.t_ns == window.t_ns, f"the observation's time is {observation.t_ns}, the window's {window.t_ns}"
    )
    require(observation.source, "the observation does not say which fingerprint it comes from: source = self.name")
    fix = observation.fix
    if fix is None:
        return
    require(fix.floor in world.floors(), f"a fix is on floor {fix.floor!r}, which the site does not have")
    require(
        np.isfinite(fix.xy).all(), f"a fix is at {fix.xy.tolist()}. Guard the division by a distance or weight of zero"
    )
    covariance = fix.covariance
    positive = np.isfinite(covariance).all() and np.allclose(covariance, covariance.T)
    positive = positive and float(np.linalg.eigvalsh(covariance).min()) > 0
    require(positive, f"a fix has covariance {covariance.tolist()}, expected a symmetric, positive definite one in m²")
    inside = -20 <= fix.xy[0] <= world.WIDTH_M + 20 and -20 <= fix.xy[1] <= world.HEIGHT_M + 20
    require(inside, f"a fix is at {fix.xy.tolist()}, far outside of the survey")
