"""Who walks in the twin of [jiang2015], with which phones: section 8.1 and Table 2, the rest chosen by us."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Rng
from tickfix.simulation import Hold, Phone, Receiver, Walker, draw_phone, draw_receiver, draw_walker

PEOPLE: Final = 4
PHONES: Final = 5
PACES: Final = (0.65, 0.85, 1.0, 1.3, 1.8)
"""Slow, middle, fast and running, as multiples of a person's preferred speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handset:
    """A phone: its motion sensors and its Wi-Fi."""

    phone: Phone
    receiver: Receiver


def draw_people(rng: Rng) -> tuple[Walker, ...]:
    """Draw the four participants, who walk without stopping."""
    return tuple(replace(draw_walker(rng), pauses_per_m=0.0) for _ in range(PEOPLE))


def draw_handsets(rng: Rng) -> tuple[Handset, ...]:
    """Draw the five phones; all sample at 65 Hz and scan about every two seconds."""
    return tuple(
        Handset(
            phone=replace(draw_phone(rng), rate_hz=65.0),
            receiver=replace(draw_receiver(rng), scan_s=(1.2, 2.0), pause_s=(0.2, 0.6), delivery_s=(0.1, 0.6)),
        )
        for _ in range(PHONES)
    )


def walking(person: Walker, pace: float, rng: Rng) -> Walker:
    """Return a person at a pace who has just taken the phone in hand: never twice quite the same way."""
    yaw, pitch, roll = np.radians([3.0, 4.0, 2.0]) * rng.standard_normal(3)
    hold: Hold = replace(
        person.hold,
        yaw_rad=person.hold.yaw_rad + float(yaw),
        pitch_rad=person.hold.pitch_rad + float(pitch),
        roll_rad=person.hold.roll_rad + float(roll),
    )
    return replace(person, speed_mps=pace * person.speed_mps, hold=hold)
