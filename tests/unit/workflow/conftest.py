"""The simulated office of the demo, surveyed once."""

from __future__ import annotations

import pytest

import tickfix
from tickfix.simulation import DemoScenario, simulate_demo


@pytest.fixture(scope="session")
def office() -> DemoScenario:
    return simulate_demo(0)


@pytest.fixture(scope="session")
def site(office: DemoScenario) -> tickfix.Site:
    return tickfix.survey([walk.recording for walk in office.survey], floors=office.building.floors, name="office")


@pytest.fixture(scope="session")
def walk(office: DemoScenario) -> tickfix.Recording:
    return office.walks[0].recording


@pytest.fixture(scope="session")
def kalman(walk: tickfix.Recording, site: tickfix.Site) -> tickfix.Track:
    return tickfix.track(walk, site, "kalman")
