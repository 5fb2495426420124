"""Readings of one source are compared with the transmitters of that source, whatever their ids look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import Context, RadioMap, Readings, Recording, Scan, Truth
from tickfix.site import survey_recordings
from tickfix_fingerprint.cross_correlation import Fncc, Ncc
from tickfix_fingerprint.elm_knn import ElmKnn
from tickfix_fingerprint.knn import Knn, Wknn
from tickfix_fingerprint.topology_knn import TopologyKnn

SECOND = 10**9
WIFI = {0: {"ap1": -50.0, "ap2": -60.0, "ap3": -70.0}, 10: {"ap1": -56.0, "ap2": -60.0, "ap3": -64.0}}
BEACONS = {"c2:01": -45.0, "c2:02": -50.0, "c2:03": -55.0}
HERE = {"ap1": -50.0, "ap2": -60.0, "ap3": -69.0}


def scan(t_s: float, readings: dict[str, float], source: str = "wifi") -> Scan:
    heard_ns = np.full(len(readings), round(t_s * SECOND))
    return Scan(transmitters=tuple(readings), rssi_dbm=list(readings.values()), heard_ns=heard_ns, source=source)


def surveyed(*, beacons: bool) -> RadioMap:
    """Survey two places 10 m apart; the beacons are heard at the first of them only."""
    walks = []
    for x, readings in WIFI.items():
        events = [Truth(t_ns=t * SECOND, floor="F1", xy=np.array([float(x), 0.0])) for t in (0, 10)]
        heard = [scan(t, readings) for t in range(1, 9)]
        if beacons and x == 0:
            heard += [scan(t + 0.5, BEACONS, "ble") for t in range(1, 9)]
        walks.append(Recording(name=f"at {x}", floor="F1", events=(*events, *heard)))
    return survey_recordings(walks, (), reach_m=0.0).site.radio_map


def test_a_survey_keeps_the_source_of_every_transmitter() -> None:
    radio_map = surveyed(beacons=True)
    assert dict(zip(radio_map.transmitters, radio_map.transmitter_source, strict=True)) == {
        "ap1": "wifi",
        "ap2": "wifi",
        "ap3": "wifi",
        "c2:01": "ble",
        "c2:02": "ble",
        "c2:03": "ble",
    }
    assert radio_map.of_sources(["ble"]).tolist() == [False, False, False, True, True, True]
    assert radio_map.transmitter_numbers("ble") == {"c2:01": 3, "c2:02": 4, "c2:03": 5}


def test_an_id_of_two_sources_is_two_transmitters() -> None:
    events = [Truth(t_ns=t * SECOND, floor="F1", xy=np.zeros(2)) for t in (0, 10)]
    heard = [scan(1, {"x": -40.0}, "wifi"), scan(1, {"x": -80.0}, "ble")]
    radio_map = survey_recordings([Recording(name="a", floor="F1", events=(*events, *heard))], ()).site.radio_map
    assert (radio_map.transmitters, radio_map.transmitter_source) == (("x", "x"), ("ble", "wifi"))
    assert radio_map.mean_matrix().tolist() == [[-80.0, -40.0]]
    assert radio_map.transmitter_numbers("wifi") == {"x": 1}


def test_a_map_without_sources_derives_them_from_the_ids() -> None:
    bare = replace(surveyed(beacons=False), transmitters=("ap1", "ap2", "ble:x"), transmitter_source=())
    assert bare.transmitter_source == ("wifi", "wifi", "ble")


def test_as_many_sources_as_transmitters_are_expected() -> None:
    with pytest.raises(ValueError, match="transmitter_source: found 1 sources, expected 3, one for every transmitter"):
        replace(surveyed(beacons=False), transmitter_source=("wifi",))


@pytest.mark.parametrize("method", [Knn, Wknn, Fncc, Ncc, ElmKnn, TopologyKnn])
def test_beacons_without_a_prefix_do_not_move_a_wifi_fix(method: type) -> None:
    params = method.Params(**{"k": 1} if hasattr(method.Params, "k") else {})
    with_beacons, without = (
        method(params, Context(radio_map=surveyed(beacons=beacons))).locate(Readings.of(scan(20, HERE)))
        for beacons in (True, False)
    )
    # topology-knn takes the mean of the nearest point and its neighbour.
    assert with_beacons.xy.tolist() == without.xy.tolist() == [5.0 if method is TopologyKnn else 0.0, 0.0]


@pytest.mark.parametrize("method", [Knn, Fncc, ElmKnn])
def test_readings_of_a_source_that_was_not_asked_for_give_no_fix(method: type) -> None:
    fingerprint = method(method.Params(), Context(radio_map=surveyed(beacons=True)))
    assert fingerprint.locate(Readings.of(scan(20, BEACONS, "ble"))) is None
    assert fingerprint.locate(Readings.of(scan(20, HERE, "ble"))) is None
