"""How people walk and how they hold their phone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Rng


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """How somebody holds the phone in the hand.

    Attributes:
        pitch_rad: of the phone's top above the horizon.
        yaw_rad: where the phone points, clockwise from where the person walks.
        roll_rad: right edge down.
        sway_rad: amplitude of the turning to and fro with every stride, a pair of steps; half of it in pitch and roll.
        wander_rad: standard deviation of the hand's slow wandering in each angle.
        wander_s: over which it decorrelates to 1/e.
    """

    pitch_rad: float = 0.7
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    sway_rad: float = 0.05
    wander_rad: float = 0.03
    wander_s: float = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Walker:
    """How somebody walks.

    Attributes:
        speed_mps: preferred.
        speed_variation: standard deviation of the speed along the way, relative; it changes over some 5 m.
        walk_ratio_ms: step length over cadence, m·s, a person's constant at any speed (Sekiya and Nagasaki 1998):
            length √(speed·ratio), cadence √(speed/ratio).
        weinberg_k: K of Weinberg (2002), m^(3/4)·s^(1/2): length = K·(a_max − a_min)^(1/4), by which steps shake.
        step_jitter: standard deviation of a step's duration, relative.
        swing_jitter: standard deviation of a step's swing a_max − a_min, relative.
        acceleration_mps2: when starting, stopping, and slowing for a corner.
        turn_rad_s: greatest rate of turning.
        pauses_per_m: how often they stop to look around.
        pause_s: shortest and longest such stop.
        stand_s: how long they stand before the first step and after the last.
        hold: of the phone.
    """

    speed_mps: float = 1.25
    speed_variation: float = 0.06
    walk_ratio_ms: float = 0.39
    weinberg_k: float = 0.43
    step_jitter: float = 0.02
    swing_jitter: float = 0.1
    acceleration_mps2: float = 1.0
    turn_rad_s: float = 2.2
    pauses_per_m: float = 0.01
    pause_s: tuple[float, float] = (2.0, 6.0)
    stand_s: float = 1.5
    hold: Hold = Hold()


def draw_walker(rng: Rng) -> Walker:
    """Draw a person: their pace, their step, their hand."""
    return Walker(
        speed_mps=float(np.clip(rng.normal(1.25, 0.12), 0.9, 1.6)),
        walk_ratio_ms=float(np.clip(rng.normal(0.39, 0.025), 0.32, 0.46)),
        weinberg_k=float(np.clip(rng.normal(0.43, 0.015), 0.39, 0.47)),
        hold=Hold(
            pitch_rad=float(np.radians(rng.uniform(30.0, 50.0))),
            yaw_rad=float(np.radians(np.clip(rng.normal(0.0, 6.0), -15.0, 15.0))),
            roll_rad=float(np.radians(rng.normal(0.0, 3.0))),
            sway_rad=float(np.radians(rng.uniform(2.0, 5.0))),
        ),
    )
