"""How far access points reach, and how shadowing correlates."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from tickfix.simulation import AccessPoint, Building, Propagation, assemble_building, declare_floor, rectangle, wall
from tickfix.simulation.fields import draw_field

PLAIN = Propagation(shadowing_db=0.0)


def hall(*walls: np.ndarray, floors: int = 1) -> Building:
    levels = [declare_floor(f"F{i}", rectangle(0, 0, 50, 20), walls, level=i) for i in range(floors)]
    ap = AccessPoint(name="ap", floor="F0", xy=(5.0, 10.0), height_m=1.2, power_dbm=-40.0)
    return assemble_building(levels, [ap], np.random.default_rng(0), propagation=PLAIN)


def test_power_falls_with_the_logarithm_of_the_distance() -> None:
    building = hall()
    dbm = building.radio.mean_dbm(building.floors[0], np.array([[6.0, 10.0], [15.0, 10.0], [45.0, 10.0]]))[:, 0]
    assert dbm == pytest.approx([-40.0, -62.0, -40.0 - 22.0 * np.log10(40.0)])


def test_every_wall_between_costs_its_decibels() -> None:
    walls = [wall((10, 0), (10, 20), doors=[3.0]), wall((12, 0), (12, 20))]
    free, walled = hall(), hall(*walls)
    places = np.array([[8.0, 10.0], [11.0, 10.0], [15.0, 10.0]])
    lost = free.radio.mean_dbm(free.floors[0], places) - walled.radio.mean_dbm(walled.floors[0], places)
    assert lost[:, 0] == pytest.approx([0.0, 3.5, 7.0])


def test_a_door_lets_waves_pass() -> None:
    free, walled = hall(), hall(wall((10, 0), (10, 20), doors=[10.0]))
    place = np.array([[15.0, 10.0]])
    assert np.allclose(free.radio.mean_dbm(free.floors[0], place), walled.radio.mean_dbm(walled.floors[0], place))


def test_floors_cost_more_than_their_distance_and_less_than_each_alone() -> None:
    building = hall(floors=3)
    dbm = [float(building.radio.mean_dbm(floor, np.array([[5.0, 11.0]]))[0, 0]) for floor in building.floors]
    assert dbm[0] - dbm[1] > 17.0
    assert dbm[1] - dbm[2] < 17.0 + 22.0 * np.log10(2.1)


def test_whoever_turns_their_back_hears_less() -> None:
    building = hall()
    place = np.array([[15.0, 10.0]])
    west, east = (
        building.radio.mean_dbm(building.floors[0], place, np.array([h]))[0, 0] for h in (-np.pi / 2, np.pi / 2)
    )
    assert west - east == pytest.approx(4.0)


def test_a_place_of_its_own_for_each_access_point_gives_the_same_as_one_for_all(building: Building) -> None:
    xy = np.random.default_rng(0).uniform(2, 25, (6, 2))
    each = np.broadcast_to(xy[:, None], (6, len(building.access_points), 2))
    floor = building.floors[0]
    assert np.array_equal(building.radio.mean_dbm(floor, xy), building.radio.mean_dbm(floor, each))


@pytest.mark.parametrize(("covariance", "expected"), [("exponential", np.exp(-1.0)), ("gaussian", np.exp(-0.5))])
def test_correlation_falls_with_distance_as_set(
    covariance: Literal["exponential", "gaussian"], expected: float
) -> None:
    field = draw_field(np.random.default_rng(0), functions=4000, sigma=4.0, length_m=5.0, covariance=covariance)
    values = field.at(np.array([[0.0, 0, 0], [0.5, 0, 0], [3.0, 4.0, 0], [30.0, 0, 0]]))
    correlation = np.atleast_2d(np.corrcoef(values))[0]
    assert values.std() == pytest.approx(4.0, rel=0.03)
    assert correlation[1] > 0.87
    assert correlation[2] == pytest.approx(expected, abs=0.05)
    assert abs(correlation[3]) < 0.06


def test_shadowing_is_the_same_for_all_who_come_by(building: Building) -> None:
    floor, xy = building.floors[0], np.array([[7.5, 8.0]])
    assert np.array_equal(building.radio.mean_dbm(floor, xy), building.radio.mean_dbm(floor, xy))


def test_an_access_point_on_an_unknown_floor_is_refused() -> None:
    with pytest.raises(ValueError, match="access point a: found floor 'F9'"):
        assemble_building(hall().floors, [AccessPoint(name="a", floor="F9", xy=(0, 0))], np.random.default_rng(0))
