"""Surveys that stand still become radio maps whose points are where somebody stood."""

from __future__ import annotations

import numpy as np

from tickfix.api import Scan
from tickfix.simulation import (
    AccessPoint,
    Receiver,
    assemble_building,
    declare_floor,
    rectangle,
    simulate_stationary_scans,
)
from tickfix.site.survey_builder import survey_recordings

FLOOR = declare_floor("F1", rectangle(0, 0, 20, 10))
POINTS = [(2.0, 5.0), (3.0, 5.0), (18.0, 5.0)]


def test_the_points_of_the_radio_map_are_those_stood_at() -> None:
    building = assemble_building([FLOOR], [AccessPoint(name="a", floor="F1", xy=(1.0, 5.0))], np.random.default_rng(1))
    receiver = Receiver(scan_s=(0.5, 0.5), pause_s=(0.0, 0.0), stale_s=0.0)
    stands = [
        simulate_stationary_scans(
            building, "F1", xy, np.random.default_rng(n), name=f"point-{n}", seconds=10.2, receiver=receiver
        )
        for n, xy in enumerate(POINTS)
    ]
    assert [sum(isinstance(event, Scan) for event in stand.events) for stand in stands] == [20, 20, 20]
    radio_map = survey_recordings(stands, [FLOOR], spacing_m=0.5, reach_m=0.0).site.radio_map
    np.testing.assert_allclose(radio_map.point_xy, POINTS)
    near, _, far = radio_map.mean_matrix()[:, 0]
    assert near > far + 10.0
