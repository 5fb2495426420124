"""The snapshots of a crew's workers as one replica's, and back: a journal does not show how many workers wrote it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from tickfix.api import Scan
from tickfix.api.packing import Packed, pack, unpack
from tickfix.drivers.live.crew.messages import Saved
from tickfix.drivers.live.crew.roll import Roll
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.replica import ReplicaSnapshot
from tickfix.kernel import KernelSnapshot
from tickfix.wire import decode_event, encode_event


def merged(parts: Sequence[Saved], roll: Roll) -> bytes:
    """Return the bytes that one replica would give, from the workers' parts and the order in which all devices came.

    Raises:
        EngineError: when a worker could not make its part.
    """
    for part in parts:
        if part.refused:
            raise EngineError(f"a worker could not make its part of a snapshot: {part.refused}")
    kernels = [KernelSnapshot.unpacked(part.rest) for part in parts]
    devices = {device: Packed(body) for part in parts for device, body in part.devices}
    sessions = {(seen.device, seen.session): seen for kernel in kernels for seen in kernel.sessions}
    order = [(seen.device, seen.session) for seen in roll.sessions.snapshot()]
    retired = {device: number for kernel in kernels for device, number in kernel.retired}
    kernel = KernelSnapshot(
        seed=kernels[0].seed,
        horizon_s=kernels[0].horizon_s,
        # The bytes of a device are not taken apart to be put together again.
        devices=cast("Any", tuple(devices[device] for device in roll.followed)),
        # A device that was lost and came back within a batch of steps has left more in the roll than with its worker.
        sessions=tuple(sessions[key] for key in order if key in sessions),
        retired=tuple((device, retired[device]) for device in roll.sessions.retired if device in retired),
        intake=tuple(sorted(summed(dict(kernel.intake) for kernel in kernels).items())),
        measurements=tuple(sorted(summed(dict(kernel.measurements) for kernel in kernels).items())),
        failures=tuple(sorted(summed(dict(kernel.failures) for kernel in kernels).items())),
    )
    waiting = tuple((number, encode_event(scan)) for number, scan in roll.waiting.items())
    return pack(ReplicaSnapshot(kernel.packed(), waiting, roll.primary))


def split(data: bytes, roll: Roll, workers: int, owner: Callable[[str], int]) -> list[bytes]:
    """Return what each worker is to restore, and restore the roll.

    Args:
        data: a replica's snapshot.
        roll: begun.
        workers: how many.
        owner: of a device.

    Raises:
        ValueError: when it is no snapshot.
    """
    kept = unpack(data, ReplicaSnapshot)
    kernel = KernelSnapshot.unpacked(kept.kernel)
    events = ((number, decode_event(body)) for number, body in kept.waiting)
    waiting = [(number, event) for number, event in events if isinstance(event, Scan)]
    parts = []
    for n in range(workers):
        part = replace(
            kernel,
            devices=tuple(device for device in kernel.devices if owner(device.device) == n),
            sessions=tuple(seen for seen in kernel.sessions if owner(seen.device) == n),
            retired=tuple((device, number) for device, number in kernel.retired if owner(device) == n),
        )
        if n:  # what was counted before belongs to nobody in particular
            part = replace(part, intake=(), measurements=(), failures=())
        scans = tuple((number, encode_event(scan)) for number, scan in waiting if owner(scan.device) == n)
        parts.append(pack(ReplicaSnapshot(part.packed(), scans, kept.primary)))
    roll.restore(kernel, waiting, kept.primary)
    return parts


def summed(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sums of counters."""
    total: Counter[str] = Counter()
    for one in counts:
        total.update(one)
    return dict(total)
