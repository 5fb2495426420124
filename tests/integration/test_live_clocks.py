"""Phones whose clocks step, drift, jitter, start anew and start wildly, beside one whose clock is right."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from live_lab import CALM, LIGHT, Lab, adds_up, estimates, last_word, repeats, same_in_the_end, until
from live_scripts import Clock, Post, in_turn, letters, walks
from stored_floor import Command

from tickfix.api import Estimate, Ints

S = 1_000_000_000
SPAN_NS = 20 * S
"""How long the phones send, at the pace of their walk; a clock that stepped back by 4 s is known again 10 s later."""
SOON_NS = 500_000_000
"""The age of the newest motion in a tick that was said when its motion had come."""
PATIENT = f"{LIGHT}[live]\ngrace_ms = 2000.0\n"
"""So that phones held up by a busy machine are not taken for phones whose clocks are wrong."""


def steps(at_s: float, by_s: float, start_s: float = 5_000.0) -> Clock:
    """Return a clock that steps."""
    return lambda t_ns: t_ns + np.where(t_ns < at_s * S, 0, round(by_s * S)) + round(start_s * S)


def reboots(at_s: float, start_s: float = 5_000.0) -> Clock:
    """Return a clock that begins at 0 again."""
    return lambda t_ns: np.where(t_ns < at_s * S, t_ns + round(start_s * S), t_ns - round(at_s * S))


def drifts(by: float) -> Clock:
    """Return a clock that runs fast, by so much of the time."""
    return lambda t_ns: t_ns + np.rint(t_ns * by).astype(np.int64) + 7 * S


def jitters(sigma_s: float) -> Clock:
    """Return a clock that no two readings of which agree."""
    rng = np.random.default_rng(8)

    def clock(t_ns: Ints) -> Ints:
        return t_ns + 60 * S + np.rint(sigma_s * S * rng.standard_normal(np.shape(t_ns))).astype(np.int64)

    return clock


CLOCKS: dict[str, tuple[Clock, int]] = {
    "right": (lambda t_ns: t_ns + 1_000 * S, 0),
    "forward": (steps(4.0, 20.0), 0),
    "leaping": (steps(4.0, 300.0), 1),
    "back": (steps(4.0, -4.0), 0),
    "far-back": (steps(4.0, -40.0), 1),
    "rebooting": (reboots(4.0), 1),
    "drifting": (drifts(200e-6), 0),
    "jittering": (jitters(0.01), 0),
    "wild": (lambda t_ns: t_ns + 4_600_000_000 * S, 0),
}
"""By device: its clock, and how many new epochs it begins."""


def published(said: list[Estimate], device: str) -> list[Estimate]:
    """Return what was said of a device when its ticks closed."""
    return [e for e in said if e.device == device and e.pipeline == "kalman" and e.revision == 0]


def age_ns(estimate: Estimate) -> int:
    """Return the age of the newest motion."""
    return SPAN_NS if estimate.motion_age_ns is None else estimate.motion_age_ns


def is_fresh(said: Iterable[Estimate]) -> bool:
    """Tell whether most ticks were said when the motion in them had come."""
    return bool(np.median([age_ns(e) for e in said]) < SOON_NS)


def test_clocks_that_go_wrong_harm_nobody_else_and_their_ticks_come_again(lab: Lab, tickfix: Command) -> None:
    (walk,) = walks(1, 40.0)
    scripts = {
        device: [letter for letter in letters(device, walk, clock) if letter.at_ns < SPAN_NS]
        for device, (clock, _) in CLOCKS.items()
    }
    calm = lab.serve(CALM, "--journal", lab.place / "calm")
    with Post(calm.at["sensors"]) as post:
        post.deliver(scripts["right"])
        post.leave(["right"])
    calm.stop()

    journal = lab.place / "journal"
    engine = lab.serve(PATIENT, "--journal", journal)
    with Post(engine.at["sensors"]) as post, engine.control() as control:
        post.play(in_turn(*scripts.values()))
        wanted = {device: new for device, (_, new) in CLOCKS.items()}
        until(lambda: {told["device"]: told["epoch"] for told in control.devices()} == wanted)
        outcomes = adds_up(control, at_least=sum(map(len, scripts.values())))
        post.leave(CLOCKS)
    engine.stop()

    assert {name for name, n in outcomes.items() if n} == {"accepted", "late"}
    same_in_the_end(lab.place / "calm", journal, but=CLOCKS.keys() - {"right"})
    said, settled = list(estimates(journal)), last_word(journal)
    for device, (_, new) in CLOCKS.items():
        track = published(said, device)
        assert {e.epoch for e in track} == set(range(new + 1)), device
        for before, after in pairwise(track):
            assert (after.epoch, after.tick) == (before.epoch, before.tick + 1) or after.epoch == before.epoch + 1, (
                device
            )
        # Ticks beyond the data, or in a gap, have no motion of their own, whenever they are said.
        moved = settled[device, "kalman", new]
        ended = [e for e in track if e.epoch == new and age_ns(moved[e.tick]) < SOON_NS]
        assert is_fresh(ended if device == "right" else ended[-20:]), f"{device}: {[age_ns(e) for e in ended]}"
    repeats(tickfix, journal)
