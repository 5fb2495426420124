"""What the wire costs: encoding and decoding of the messages that come and go most.

    python benchmarks/wire.py

Prints the median time per call over several runs, in one process and thread: of the processor, so that other work on
the machine does not count.
"""

from __future__ import annotations

import platform
import statistics
import time
import timeit
from collections.abc import Callable

import msgpack
import numpy as np

from tickfix.api import Belief, Component, Estimate, Fix, MotionSamples, Samples, Scan, Status
from tickfix.wire import (
    MessageLimits,
    WireError,
    decode_estimate,
    decode_event,
    decode_message,
    encode_estimate,
    encode_event,
    event_to_message,
    message_to_event,
    unknown_fields,
)

REPEATS = 31
CALLS = 300
SENSORS = {"accelerometer": 3, "gyroscope": 3, "magnetometer": 3, "rotation_vector": 4}
LIMITS = MessageLimits()


def motion() -> MotionSamples:
    """Return 50 samples of each of four sensors."""
    rng = np.random.default_rng(0)
    t_ns = 10**15 + 20_000_000 * np.arange(50)
    sensors = {name: Samples(t_ns, rng.normal(size=(50, columns))) for name, columns in SENSORS.items()}
    return MotionSamples(sensors=sensors, device="phone-17", session="a81f09cc", seq=4711)


def scan(readings: int) -> Scan:
    """Return a scan."""
    rng = np.random.default_rng(1)
    ids = tuple(f"aa:bb:cc:00:{i // 256:02x}:{i % 256:02x}" for i in range(readings))
    heard_ns = 10**15 + np.arange(readings)
    return Scan(transmitters=ids, rssi_dbm=rng.normal(-70, 8, readings), heard_ns=heard_ns, device="phone-17")


def estimate(components: int) -> Estimate:
    """Return an estimate with a mixture of this many Gaussians."""
    part = Component(weight=1.0, floor="F1", xy=[1.0, 2.0], covariance=np.eye(2))
    belief = Belief(
        floor="F1",
        xy=[12.5, 3.0],
        covariance=[[2.0, 0.1], [0.1, 3.0]],
        floor_probabilities=(("F1", 0.9), ("F2", 0.1)),
        mixture=(part,) * components,
        speed_mps=1.2,
        heading_rad=0.3,
    )
    return Estimate(
        device="phone-17",
        pipeline="fusion",
        epoch=0,
        tick=5_000_000,
        t_ns=10**15,
        status=Status.TRACKING,
        belief=belief,
        motion_age_ns=3_000_000,
        observation_age_ns=800_000_000,
        reasons=("recovered",),
    )


def as_lists(event: MotionSamples) -> bytes:
    """Return the message with its arrays as lists."""
    sensors = {name: {"t_ns": s.t_ns.tolist(), "values": s.values.tolist()} for name, s in event.sensors.items()}
    packed: bytes = msgpack.packb({"v": 1, "type": "motion", "device": "phone-17", "sensors": sensors})
    return packed


def refused(data: bytes) -> None:
    """Decode what is refused."""
    try:
        decode_message(data, LIMITS)
    except WireError:
        return
    raise AssertionError("it was understood")


def main() -> None:
    """Measure and print."""
    samples, heard = motion(), scan(50)
    sent, listed, heard_sent = event_to_message(samples, ack=True), as_lists(samples), event_to_message(heard)
    fix = event_to_message(Fix(t_ns=1, floor="F1", xy=[1.0, 2.0], device="phone-17"))
    canonical, plain, mixed = encode_event(samples), estimate(0), estimate(8)
    body = encode_estimate(plain)
    # Nine bytes of text in place of the last float64.
    wrong = listed[:-9] + msgpack.packb("no float")
    cases: dict[str, Callable[[], object]] = {
        f"encode_estimate, {len(body)} bytes": lambda: encode_estimate(plain),
        "encode_estimate, 8 Gaussians": lambda: encode_estimate(mixed),
        "decode_estimate": lambda: decode_estimate(body),
        f"motion 4 × 50, bin, {len(sent)} bytes: decode_message": lambda: decode_message(sent, LIMITS),
        "  and to_event": lambda: message_to_event(decode_message(sent, LIMITS), 1),
        f"motion 4 × 50, lists, {len(listed)} bytes: both": lambda: message_to_event(decode_message(listed, LIMITS), 1),
        f"scan of 50, bin, {len(heard_sent)} bytes: both": lambda: message_to_event(
            decode_message(heard_sent, LIMITS), 1
        ),
        f"fix, {len(fix)} bytes: both": lambda: message_to_event(decode_message(fix, LIMITS), 1),
        "unknown_fields of the motion": lambda: unknown_fields(sent),
        "encode_event of the motion": lambda: encode_event(samples),
        "decode_event of the motion": lambda: decode_event(canonical),
        "refusing 200 bytes of garbage": lambda: refused(b"\xc1" * 200),
        "refusing the motion in lists for its last value": lambda: refused(wrong),
    }
    print(f"processor time, one thread, {platform.machine()}, Python {platform.python_version()}")
    for name, call in cases.items():
        taken = [timeit.timeit(call, timer=time.process_time, number=CALLS) / CALLS for _ in range(REPEATS)]
        print(f"  {name:52s} {1e6 * statistics.median(taken):8.1f} µs")


if __name__ == "__main__":
    main()
