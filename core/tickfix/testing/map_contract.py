"""What every floor map must keep."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tickfix.api import Context, Floats, Floor, frozen
from tickfix.testing import world
from tickfix.testing.contract import AlgorithmContract, pure_call, require
from tickfix.testing.world import ReferenceMap

_N_POINTS = 1500


class MapContract(AlgorithmContract):
    """Checks of a floor map: ``class TestMine(MapContract): algorithm = Mine``.

    Set in the subclass, where it does not fit:
        tolerance_m: moves and points closer than this to a line may go either way: half a pixel, for a raster.
    """

    tolerance_m: float = 1e-6

    def context(self) -> Context:
        """Return the site with the floor to map."""
        return world.context(floor=world.floors()["F1"])

    def test_results_have_the_shapes_and_types_that_filters_rely_on(self) -> None:
        """(n,) of bool and (n, 2) of float, for many, for one and for none."""
        for floor in _test_floors():
            mapped = self._map(floor)
            for n in (0, 1, 7):
                a, b = _random_points(n, 1), _random_points(n, 2)
                contains, crosses, free = self._ask(mapped, a, b)
                for name, value in (("contains", contains), ("crosses", crosses)):
                    right = isinstance(value, np.ndarray) and value.shape == (n,) and value.dtype == np.bool_
                    require(right, f"{name} of {n} gave {_describe_array(value)}, expected ({n},) of bool")
                right = isinstance(free, np.ndarray) and free.shape == (n, 2) and free.dtype == np.float64
                require(right, f"nearest_free of {n} gave {_describe_array(free)}, expected ({n}, 2) of float64")

    def test_a_move_crosses_what_it_crosses_backwards(self) -> None:
        """From a to b and from b to a are one way."""
        for floor in _test_floors():
            mapped, a, b = self._map(floor), _random_points(_N_POINTS, 3), _random_points(_N_POINTS, 4)
            with pure_call("crosses"):
                there, back = mapped.crosses(a, b), mapped.crosses(b, a)
            differ = np.flatnonzero(there != back)
            require(not len(differ), f"on {floor.name}: {_describe_first(a, b, differ)} crosses in one direction only")

    def test_crossings_are_those_of_the_drawing(self) -> None:
        """Compared with shapely, one by one: walls, outline and obstacles, short moves and long ones."""
        for floor in _test_floors():
            mapped, plain = self._map(floor), ReferenceMap(floor)
            for length_m in (0.3, 2.0, 40.0):
                a = _random_points(_N_POINTS // 3, 5)
                b = frozen(a + world.rng(6).normal(0.0, length_m, a.shape))
                with pure_call("crosses"):
                    found = mapped.crosses(a, b)
                expected, distance = plain.crosses(a, b), plain.distance_m(a, b)
                clear = (distance > self.tolerance_m) | expected
                missed = np.flatnonzero(expected & ~found)
                if self.tolerance_m > 1e-3:
                    missed = missed[~_near_their_ends(plain, a[missed], b[missed], self.tolerance_m)]
                require(
                    not len(missed), f"on {floor.name}: {_describe_first(a, b, missed)} passes through a wall unnoticed"
                )
                invented = np.flatnonzero(found & ~expected & clear)
                require(
                    not len(invented),
                    f"on {floor.name}: {_describe_first(a, b, invented)} is said to cross, but meets no wall",
                )

    def test_no_wall_is_too_thin_to_be_noticed(self) -> None:
        """A move that ends beyond a wall crossed it, however short it is and wherever it began."""
        mapped = self._map(world.floors()["F1"])
        y = np.linspace(0.2, 4.3, 60)
        for reach_m in (0.02 + self.tolerance_m, 0.5, 3.0):
            a, b = (
                frozen(np.column_stack([5.0 - reach_m + 0 * y, y])),
                frozen(np.column_stack([5.0 + reach_m + 0 * y, y])),
            )
            with pure_call("crosses"):
                missed = np.flatnonzero(~mapped.crosses(a, b))
            require(not len(missed), f"{_describe_first(a, b, missed)} passes through a wall unnoticed")

    def test_a_door_can_be_passed(self) -> None:
        """The gap in the wall of F1 lies between y = 4.5 m and 6 m."""
        mapped = self._map(world.floors()["F1"])
        a, b = frozen([[4.5, 5.2]]), frozen([[5.5, 5.3]])
        with pure_call("crosses"):
            blocked = bool(mapped.crosses(a, b)[0])
        require(not blocked, "a move through the door is said to cross the wall")

    def test_standing_still_crosses_nothing(self) -> None:
        """A move of no length, in the open."""
        for floor in _test_floors():
            mapped, xy = self._map(floor), _random_points(300, 7)
            xy = xy[ReferenceMap(floor).distance_m(xy, xy) > max(self.tolerance_m, 1e-6)]
            with pure_call("crosses"):
                crossed = mapped.crosses(xy, xy)
            require(not crossed.any(), f"on {floor.name}: standing still is said to cross a wall")

    def test_one_can_stand_where_the_drawing_says_so(self) -> None:
        """Inside the outline, outside of obstacles; a floor without outline has no edge."""
        for floor in _test_floors():
            mapped, plain, xy = self._map(floor), ReferenceMap(floor), _random_points(_N_POINTS, 8)
            with pure_call("contains"):
                found = mapped.contains(xy)
            clear = plain.distance_m(xy, xy) > self.tolerance_m
            wrong = np.flatnonzero((found != plain.contains(xy)) & clear)
            require(not len(wrong), f"on {floor.name}: contains is wrong at {xy[wrong[:1]].tolist()}")

    def test_the_nearest_free_place_is_free_and_near(self) -> None:
        """What is free stays, to the bit; what is not moves to a place where one can stand, no further than needed."""
        for floor in _test_floors():
            mapped, xy = self._map(floor), _random_points(_N_POINTS, 9)
            with pure_call("nearest_free"):
                free, was = mapped.nearest_free(xy), mapped.contains(xy)
                now = mapped.contains(free)
            require(
                now.all(),
                f"on {floor.name}: nearest_free moved {_describe_first(xy, free, np.flatnonzero(~now))}, not free",
            )
            kept = free[was].tobytes() == xy[was].tobytes()
            require(kept, f"on {floor.name}: nearest_free moved a point where one can stand")
            further = np.hypot(*(free - xy).T) - ReferenceMap(floor).outside_m(xy)
            worst = np.flatnonzero(further > 0.5 + 2 * self.tolerance_m)
            require(
                not len(worst),
                f"on {floor.name}: nearest_free moved {_describe_first(xy, free, worst)}, over 0.5 m too far",
            )

    def test_snapping_ends_where_one_can_stand(self) -> None:
        """With a previous place and without."""
        for floor in _test_floors():
            mapped, before, xy = self._map(floor), _random_points(200, 10), _random_points(200, 11)
            for p, q in zip(before, xy, strict=True):
                for previous in (None, p):
                    with pure_call("snap"):
                        snapped = mapped.snap(previous, q)
                        free = mapped.contains(snapped[None])[0]
                    require(snapped.shape == (2,), f"snap gave {_describe_array(snapped)}, expected (2,)")
                    require(free, f"on {floor.name}: snap({previous}, {q.tolist()}) gave {snapped.tolist()}, not free")

    def test_snapping_does_not_pass_walls(self) -> None:
        """Coming from a free place, what is snapped lies on the same side."""
        floor = world.floors()["F1"]
        mapped, plain, before, xy = (
            self._map(floor),
            ReferenceMap(floor),
            _random_points(300, 12),
            _random_points(300, 13),
        )
        far = (plain.distance_m(before, before) > 0.3 + self.tolerance_m) & plain.contains(before)
        for p, q in zip(before[far], xy[far], strict=True):
            with pure_call("snap"):
                snapped = mapped.snap(p, q)
            crossed = plain.crosses(p[None], snapped[None])[0]
            require(
                not crossed, f"snap({p.tolist()}, {q.tolist()}) gave {snapped.tolist()}, on the other side of a wall"
            )

    def test_asking_twice_gives_the_same(self) -> None:
        """Nothing may depend on what was asked before."""
        floor = world.floors()["F1"]
        one, two, a, b = self._map(floor), self._map(floor), _random_points(300, 14), _random_points(300, 15)
        self._ask(two, b, a)
        first, second, other = ([v.tobytes() for v in self._ask(m, a, b)] for m in (one, one, two))
        require(first == second == other, "the same question got two answers")

    def test_each_place_is_judged_by_itself(self) -> None:
        """Filters call maps for many devices together: other rows may not change a result, not even by a bit."""
        for floor in _test_floors():
            mapped, a = self._map(floor), _random_points(300, 16)
            b = frozen(a + world.rng(20, 17).normal(0.0, 0.5, a.shape))
            all_at_once = self._ask(mapped, a, b)
            for some in (slice(0, 1), slice(1, None, 3), *(slice(n, n + 7) for n in range(0, len(a) - 7, 7))):
                by_itself = self._ask(mapped, frozen(a[some]), frozen(b[some]))
                for name, one, other in zip(
                    ("contains", "crosses", "nearest_free"), all_at_once, by_itself, strict=True
                ):
                    same = one[some].tobytes() == other.tobytes()
                    require(same, f"on {floor.name}: {name} differs for {len(other)} places alone and among 300")

    def _map(self, floor: Floor) -> Any:
        return self.make(dataclasses.replace(world.context(), floor=floor))

    @staticmethod
    def _ask(mapped: Any, a: Floats, b: Floats) -> tuple[Any, Any, Any]:
        with pure_call(f"a question about {len(a)} points"):
            return mapped.contains(a), mapped.crosses(a, b), mapped.nearest_free(a)


def _test_floors() -> list[Floor]:
    """Return the world's floors, and floors without this or that."""
    f1, f2 = world.floors()["F1"], world.floors()["F2"]
    bare = Floor(name="walls only", width_m=f1.width_m, height_m=f1.height_m, walls=f1.walls)
    return [f1, f2, bare, Floor(name="empty", width_m=20.0, height_m=12.0)]


def _random_points(n: int, key: int) -> Floats:
    return frozen(world.rng(20, key).uniform([-3.0, -3.0], [world.WIDTH_M + 3.0, world.HEIGHT_M + 3.0], (n, 2)))


def _near_their_ends(plain: ReferenceMap, a: Floats, b: Floats, tolerance_m: float) -> Any:
    """Return which moves meet lines so close to their ends that a raster may miss it."""
    ends = np.minimum(plain.distance_m(a, a), plain.distance_m(b, b))
    return ends <= 2.0 * tolerance_m


def _describe_first(a: Floats, b: Floats, rows: Any) -> str:
    if len(rows) == 0:
        return ""
    n = int(rows[0])
    return f"{np.round(a[n], 3).tolist()} → {np.round(b[n], 3).tolist()} ({len(rows)} such)"


def _describe_array(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.shape} of {value.dtype}"
    return type(value).__name__
