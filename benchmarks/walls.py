"""Wall crossings: the exact index of ``walls`` beside a tree of shapely and plain numpy, on the same moves.

    python benchmarks/walls.py

Prints the median time per call over many repetitions in one run, taken in turn, and checks that all three agree.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable

import numpy as np
import shapely

from tickfix.api import Bools, Context, Floats
from tickfix.simulation import simulate_demo
from tickfix_maps.walls import Walls, WallsParams, wall_segments

MOVES = 1000
REPEATS = 200


def main() -> None:
    """Measure and print."""
    floor = simulate_demo(seed=0).building.floors[0]
    walls = Walls(WallsParams(), Context(floor=floor))
    segments = wall_segments(floor)
    rng = np.random.default_rng(0)
    a = rng.uniform([0.0, 0.0], [floor.width_m, floor.height_m], (MOVES, 2))
    b = a + 0.5 * rng.standard_normal((MOVES, 2))
    tree = shapely.STRtree(shapely.linestrings(segments))

    def by_tree(a: Floats, b: Floats) -> Bools:
        crossed = np.zeros(len(a), dtype=np.bool_)
        crossed[tree.query(shapely.linestrings(np.stack([a, b], axis=1)), predicate="intersects")[0]] = True
        return crossed

    methods: dict[str, Callable[[Floats, Floats], Bools]] = {
        "tickfix walls": walls.crosses,
        "shapely STRtree": by_tree,
        "plain numpy": lambda a, b: brute_force(a, b, segments),
    }
    answers = [method(a, b) for method in methods.values()]
    assert all((answer == answers[0]).all() for answer in answers), "the methods disagree"
    times: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(REPEATS):
        for name, method in methods.items():
            begun = time.perf_counter()
            method(a, b)
            times[name].append(time.perf_counter() - begun)
    print(f"{MOVES} moves × {len(segments)} segments, {int(answers[0].sum())} cross; {platform.machine()}")
    for name, taken in times.items():
        print(f"  {name:16s} {1e6 * statistics.median(taken):9.0f} µs")


def brute_force(a: Floats, b: Floats, segments: Floats) -> Bools:
    """Test every move against every segment."""
    p, q = segments[None, :, 0], segments[None, :, 1]
    a, b = a[:, None], b[:, None]

    def side(o: Floats, d: Floats, x: Floats) -> Floats:
        return np.sign((d - o)[..., 0] * (x - o)[..., 1] - (d - o)[..., 1] * (x - o)[..., 0])

    crossed: Bools = ((side(a, b, p) * side(a, b, q) <= 0) & (side(p, q, a) * side(p, q, b) <= 0)).any(axis=1)
    return crossed


if __name__ == "__main__":
    main()
