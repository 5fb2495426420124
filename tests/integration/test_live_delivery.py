"""A lossy way between phones and the engine: messages reordered, repeated, delayed, dropped, and far too late."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from live_lab import CALM, LIGHT, Lab, adds_up, estimates, repeats, same_in_the_end, until
from live_scripts import Letter, Post, in_turn, letters, walks
from stored_floor import Command

from tickfix.api import Rng

SEED = 12
S = 1_000_000_000
SPAN_NS = 35 * S
"""How much of each walk is sent."""


@dataclass
class Way:
    """What a lossy way makes of scripts.

    Attributes:
        arrivals: letters with the times of their arrival.
    """

    arrivals: list[tuple[int, Letter]] = field(default_factory=list)

    def lead(self, script: list[Letter], delays_ns: Callable[[Letter], list[int]]) -> list[Letter]:
        """Lead a script over it; return what arrives at all, once each, in the order in which it was sent.

        Args:
            script: of one device.
            delays_ns: how long each arrival of a letter takes; none drops it.
        """
        arrived = []
        for letter in script:
            taken = delays_ns(letter)
            self.arrivals += [(letter.at_ns + taken_ns, letter) for taken_ns in taken]
            if taken:
                arrived.append(letter)
        return arrived

    def in_order(self) -> list[Letter]:
        """Return what arrives, in that order."""
        return [letter for _, letter in sorted(self.arrivals, key=lambda arrival: arrival[0])]


def disorder(rng: Rng, *, again: float = 0.0, drop: float = 0.0) -> Callable[[Letter], list[int]]:
    """Each letter takes up to 0.4 s and so overtakes others; one in ten takes up to 4 s.

    Args:
        rng: draws delays.
        again: share of letters that arrive twice.
        drop: share that never does.
    """

    def delay_ns() -> int:
        return int(rng.uniform(0.0, 4.0 * S if rng.random() < 0.1 else 0.4 * S))

    def delays_ns(_: Letter) -> list[int]:
        if rng.random() < drop:
            return []
        return [delay_ns() for _ in range(1 + (rng.random() < again))]

    return delays_ns


def test_what_is_reordered_repeated_delayed_or_dropped_settles_as_what_arrives_in_order(
    lab: Lab, tickfix: Command
) -> None:
    rng, way = np.random.default_rng(SEED), Way()
    steady, shuffled, lossy, tardy = (
        [letter for letter in letters(device, walk) if letter.at_ns < SPAN_NS]
        for device, walk in zip(("steady", "shuffled", "lossy", "tardy"), walks(4, 40.0), strict=True)
    )
    # Every fifteenth letter of this one comes when the horizon has passed it by far, and a whole second of them.
    beyond = {letter.seq for letter in tardy if letter.at_ns < 15 * S and letter.seq % 15 == 0}
    beyond |= {letter.seq for letter in tardy if 5 * S < letter.at_ns < 8 * S}
    way.lead(steady, lambda _: [0])
    way.lead(shuffled, disorder(rng, again=0.1))
    arrived = way.lead(lossy, disorder(rng, again=0.05, drop=0.1))
    way.lead(tardy, lambda letter: [16 * S if letter.seq in beyond else 0])
    in_time = [letter for letter in tardy if letter.seq not in beyond]

    calm = lab.serve(CALM, "--journal", lab.place / "calm")
    with Post(calm.at["sensors"]) as post:
        post.deliver(in_turn(steady, shuffled, arrived, in_time))
        post.leave(["steady", "shuffled", "lossy", "tardy"])
    calm.stop()

    engine = lab.serve(LIGHT, "--journal", lab.place / "journal")
    with Post(engine.at["sensors"]) as post, engine.control() as control:
        sent = way.in_order()
        post.deliver(sent)
        outcomes = adds_up(control, at_least=len(sent))
        gaps = {letter.seq for letter in arrived}
        until(lambda: control.counters()["engine"]["missing_messages"] == max(gaps) - len(gaps))
        told = {device: dict(counter) for device, counter in post.outcomes.items()}
        post.leave(["steady", "shuffled", "lossy", "tardy"])
    measurements = engine.stop()["measurements"]

    arrivals = Counter(letter.device for letter in sent)
    for device, script in (("steady", steady), ("shuffled", shuffled), ("lossy", arrived), ("tardy", tardy)):
        unused = told[device].get("stale", 0), told[device].get("duplicate", 0)
        assert unused == (len(beyond) if device == "tardy" else 0, arrivals[device] - len(script)), device
        assert sum(told[device].values()) == arrivals[device]
    assert +Counter(outcomes) == sum(map(Counter, told.values()), Counter())
    assert len(lossy) - len(arrived) > 20
    assert measurements["stale"] == sum(letter.measurements for letter in tardy if letter.seq in beyond)
    assert not measurements.get("dropped")

    same_in_the_end(lab.place / "calm", lab.place / "journal")
    published = [e.tick for e in estimates(lab.place / "journal") if e.device == "steady" and e.revision == 0]
    assert set(published) == set(range(min(published), max(published) + 1))
    repeats(tickfix, lab.place / "journal")
