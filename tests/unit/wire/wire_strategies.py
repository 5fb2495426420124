"""Arbitrary events and estimates, for laws about their bytes."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tickfix.api import SENSORS, Belief, Component, Estimate, Fix, MotionSamples, Pressure, Samples, Scan, Status, Truth

INT64 = st.integers(-(2**63) + 1, 2**63 - 1)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
FLOAT = st.floats() | st.sampled_from([-0.0, float("nan"), float("inf"), -float("inf"), 5e-324])


def floats(*shape):
    """Return arrays of a shape, of any float64."""
    return hnp.arrays(np.float64, shape, elements=FLOAT)


def ints(n):
    """Return (n,) int64 of any value."""
    return hnp.arrays(np.int64, n, elements=INT64)


def common(text, name):
    """Return what all events have."""
    fields = {"device": name, "session": text, "seq": st.integers(0, 2**63 - 1), "arrival_ns": INT64}
    return st.fixed_dictionaries(fields)


@st.composite
def motions(draw, text, name):
    """Return motion samples of some sensors."""
    sensors = {}
    for sensor in draw(st.lists(st.sampled_from([*sorted(SENSORS), "light"]), unique=True)):
        n = draw(st.integers(0, 4))
        columns = SENSORS[sensor][0] if sensor in SENSORS else draw(st.integers(1, 5)) if n else 0
        sensors[sensor] = Samples(draw(ints(n)), draw(floats(n, columns)))
    return MotionSamples(sensors=sensors, t0_ns=draw(INT64), t1_ns=draw(INT64), **draw(common(text, name)))


@st.composite
def scans(draw, text, name):
    """Return scans."""
    n = draw(st.integers(0, 4))
    return Scan(
        transmitters=tuple(draw(st.lists(TEXT, min_size=n, max_size=n))),
        rssi_dbm=draw(floats(n)),
        heard_ns=draw(ints(n)),
        t_ns=draw(INT64),
        source=draw(text),
        values=draw(st.dictionaries(text, floats(n), max_size=2)),
        **draw(common(text, name)),
    )


@st.composite
def others(draw, text, name):
    """Return pressures, fixes and truths."""
    t_ns, fields = draw(INT64), draw(common(text, name))
    kind = draw(st.sampled_from([Pressure, Fix, Truth]))
    if kind is Pressure:
        return Pressure(t_ns=t_ns, pressure_hpa=draw(FLOAT), **fields)
    place = {"floor": draw(text), "xy": draw(floats(2))}
    if kind is Truth:
        return Truth(t_ns=t_ns, **place, **fields)
    return Fix(t_ns=t_ns, covariance=draw(floats(2, 2)), source=draw(text), **place, **fields)


def events(text, name):
    """Return events whose texts, and names of devices, are these."""
    return motions(text, name) | scans(text, name) | others(text, name)


_PRINTED = st.characters(exclude_categories=["Cs", "Cc"])
EVENTS = events(TEXT, TEXT)
SENT = events(st.text(_PRINTED, max_size=12), st.text(_PRINTED, min_size=1, max_size=12))
"""Events that a device may send: its name is not empty, and names hold no control characters."""


@st.composite
def beliefs(draw):
    """Return beliefs, finite or not."""
    components = st.builds(Component, weight=FLOAT, floor=TEXT, xy=floats(2), covariance=floats(2, 2))
    return Belief(
        floor=draw(TEXT),
        xy=draw(floats(2)),
        covariance=draw(floats(2, 2)),
        floor_probabilities=tuple(draw(st.lists(st.tuples(TEXT, FLOAT), max_size=3))),
        mixture=tuple(draw(st.lists(components, max_size=3))),
        speed_mps=draw(st.none() | FLOAT),
        heading_rad=draw(st.none() | FLOAT),
    )


ESTIMATES = st.builds(
    Estimate,
    device=TEXT,
    pipeline=TEXT,
    epoch=INT64,
    tick=INT64,
    t_ns=INT64,
    status=st.sampled_from(Status),
    belief=st.none() | beliefs(),
    motion_age_ns=st.none() | INT64,
    observation_age_ns=st.none() | INT64,
    innovation_m=st.none() | FLOAT,
    nis=st.none() | FLOAT,
    failed_by=TEXT,
    reasons=st.lists(TEXT, max_size=3).map(tuple),
    diagnostics=st.dictionaries(TEXT, FLOAT, max_size=3),
    revision=INT64,
)


def content(value):
    """Return what a value holds as something that compares bit for bit."""
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.shape, value.tobytes())
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, (list, tuple)):
        return tuple(content(one) for one in value)
    if hasattr(value, "items"):
        return tuple((key, content(one)) for key, one in sorted(value.items()))
    if hasattr(value, "__slots__") and not isinstance(value, str):
        fields = type(value).__dataclass_fields__
        return (type(value).__name__, *(content(getattr(value, name)) for name in fields))
    return value
