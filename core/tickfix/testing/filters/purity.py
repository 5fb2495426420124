"""What makes a filter's track a fold: a step depends on its arguments alone, and changes none of them."""

from __future__ import annotations

from tickfix.api import pack, unpack
from tickfix.testing import world
from tickfix.testing.calls import require
from tickfix.testing.filters.together import check_many
from tickfix.testing.filters.walking import WalkedFilter


class PureFilter(WalkedFilter):
    """Checks that a filter keeps nothing outside of its states."""

    def test_a_step_is_a_function_of_its_arguments(self) -> None:
        """The kernel goes back and folds again: the same arguments must give the same bits."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            first, second = (pack(self._step(algorithm, state, tick)[0]) for _ in range(2))
            require(first == second, "step gave two results for the same arguments. Keep nothing outside of the state")

    def test_two_tracks_do_not_disturb_each_other(self) -> None:
        """One instance follows all devices, in turn."""
        alone = [pack(state) for state, _, _ in self._fold(world.walk(60), self.make())]
        shared = self.make()
        other = self._fold(world.walk(60, shift=(3.0, 1.0)), shared)
        together = [pack(mine[0]) for mine, _ in zip(self._fold(world.walk(60), shared), other, strict=True)]
        require(
            alone == together, "a track changed when another one was followed too. Keep nothing on self between calls"
        )

    def test_old_states_stay_as_they_were(self) -> None:
        """A step that writes into the arrays of its state changes the past to which the kernel goes back."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            before = pack(state)
            self._step(algorithm, state, tick)
            require(pack(state) == before, "step changed the state it was given. Write into a copy, return a new state")
            self._estimate(algorithm, state)
            require(pack(state) == before, "estimate changed the state it was given")

    def test_estimate_says_the_same_twice(self) -> None:
        """It tells what the state means: it draws nothing and learns nothing."""
        algorithm = self.make()
        for state, _ in self._pairs(algorithm, 30):
            first, second = (self._estimate(algorithm, state) for _ in range(2))
            same = (
                first.xy.tobytes() == second.xy.tobytes() and first.covariance.tobytes() == second.covariance.tobytes()
            )
            require(same, "estimate said two things of one state")

    def test_an_unpacked_state_goes_on_like_the_one_packed(self) -> None:
        """A restarted process continues bit for bit."""
        algorithm = self.make()
        for state, tick in self._pairs(algorithm, 60):
            again = unpack(pack(state), self.algorithm.State)
            kept, unpacked = (pack(self._step(algorithm, s, tick)[0]) for s in (state, again))
            require(kept == unpacked, "an unpacked state goes on differently: does State hold all that step uses?")

    def test_randomness_comes_from_the_rng_alone(self) -> None:
        """Two instances with the same streams agree; the clock, other generators and ids are out of bounds."""
        one, two = ([pack(s) for s, _, _ in self._fold(world.walk(60), self.make())] for _ in range(2))
        require(one == two, "two instances with the same random streams disagree. Draw from the rng given only")

    def test_many_devices_at_once_are_each_as_if_alone(self) -> None:
        """Asked only of a filter that offers ``step_many``: whoever is asked for with whom changes no bits."""
        offered = [name for name in ("step_many", "estimate_many") if hasattr(self.algorithm, name)]
        if not offered:
            return
        require(len(offered) == 2, f"the class has {offered[0]} alone. Write both step_many and estimate_many")
        check_many(self.make(), ticks=40)
        check_many(self._few_in_a_building(), ticks=12)
