"""A building: its floors, access points and magnetic field, the same for all who walk in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.api import Floor, Rng
from tickfix.simulation.fields import MagneticField, Magnetism, draw_magnetic_field
from tickfix.simulation.floor_plans import office_floor
from tickfix.simulation.radio_channel import AccessPoint, Propagation, Radio, draw_radio


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """What stays as it is from the survey to the last walk.

    Attributes:
        floors: plans, by which people walk and waves travel.
        radio: the access points and their reach.
        magnetic: the field, and where magnetic north is on the map.
    """

    floors: tuple[Floor, ...]
    radio: Radio
    magnetic: MagneticField

    @property
    def access_points(self) -> tuple[AccessPoint, ...]:
        """The transmitters of all floors."""
        return self.radio.access_points

    def floor(self, name: str) -> Floor:
        """Return the floor of this name.

        Raises:
            ValueError: naming the floors there are.
        """
        for floor in self.floors:
            if floor.name == name:
                return floor
        raise ValueError(f"floor: found {name!r}, expected one of {', '.join(floor.name for floor in self.floors)}")


def assemble_building(
    floors: Sequence[Floor],
    access_points: Sequence[AccessPoint],
    rng: Rng,
    *,
    propagation: Propagation | None = None,
    magnetism: Magnetism | None = None,
) -> Building:
    """Build a building of declared floors and access points; shadowing and magnetic disturbance are drawn."""
    radio_rng, magnetic_rng = rng.spawn(2)
    return Building(
        floors=tuple(floors),
        radio=draw_radio(propagation or Propagation(), tuple(floors), tuple(access_points), radio_rng),
        magnetic=draw_magnetic_field(magnetism or Magnetism(), magnetic_rng),
    )


def place_access_points(floor: Floor, count: int, rng: Rng) -> tuple[AccessPoint, ...]:
    """Hang access points as an installer would: spread evenly over the drawing, none quite where it was planned.

    Args:
        floor: where they hang; the rectangle of its drawing is filled.
        count: how many.
        rng: draws the deviation from the plan, the transmit power and the channel.
    """
    columns = max(1, round(float(np.sqrt(count * floor.width_m / floor.height_m))))
    rows = -(-count // columns)
    # The last row may be short: its points spread over the whole width like those of the others.
    counts = [len(range(row, count, rows)) for row in range(rows)]
    points = []
    for row, n in enumerate(counts):
        for column in range(n):
            u, v = np.array([column, row]) + 0.5 + rng.uniform(-0.3, 0.3, 2)
            points.append((float(u / n * floor.width_m), float(v / rows * floor.height_m)))
    return tuple(
        AccessPoint(
            name=f"02:00:00:{floor.level % 256:02x}:{i // 256:02x}:{i % 256:02x}",
            floor=floor.name,
            xy=xy,
            power_dbm=-38.0 + float(rng.normal(0.0, 2.0)),
            channel=float(rng.choice([0.02, 0.2, 0.4, 0.6, 0.8, 0.98])),
        )
        for i, xy in enumerate(points)
    )


def office_building(
    rng: Rng,
    *,
    storeys: int = 1,
    width_m: float = 60.0,
    height_m: float = 36.0,
    access_points: int = 24,
    propagation: Propagation | None = None,
    magnetism: Magnetism | None = None,
) -> Building:
    """Build an office: ``storeys`` floors F1, F2 …, each with ``access_points`` of them."""
    floor_rngs = rng.spawn(storeys)
    floors = [
        office_floor(floor_rngs[i], name=f"F{i + 1}", level=i, width_m=width_m, height_m=height_m)
        for i in range(storeys)
    ]
    points = [p for i, f in enumerate(floors) for p in place_access_points(f, access_points, floor_rngs[i])]
    return assemble_building(floors, points, rng, propagation=propagation, magnetism=magnetism)
