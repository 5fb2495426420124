"""The fingerprint stage as a service: it takes scans from an engine's follow port and sends back fixes."""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import zmq

from tickfix.api import Fix, Scan
from tickfix.client import Keys, Sensor
from tickfix.client.connection import connect_socket, open_client_socket
from tickfix.kernel import Stage
from tickfix.kernel.measurements import RecentScans
from tickfix.wire import WireError, decode_event

_LOGGER = logging.getLogger(__name__)

_MAX_DEVICES: Final = 4_096
_CLOCK_RESTART_NS: Final = 60_000_000_000
_IDLE_MS: Final = 200


@dataclass(slots=True)
class _DeviceState:
    scans: RecentScans = field(default_factory=RecentScans)
    state: Any = None
    newest_ns: int = 0


class StatefulLocator:
    """Locates scans, each with the window of those before it; keeps one state per device.

    Args:
        stage: the fingerprint.
    """

    def __init__(self, stage: Stage) -> None:
        """Begin with no device."""
        self._fingerprint = stage.algorithm
        self._devices: OrderedDict[str, _DeviceState] = OrderedDict()

    def locate(self, scan: Scan) -> Fix | None:
        """Return the fix that a scan brings, if any; what the fingerprint raises is raised here.

        Scans of a device come in their order; one that is older than the one before it is located all the same.
        """
        if scan.source not in self._fingerprint.window.sources:
            return None
        device = self._devices.pop(scan.device, None) or _DeviceState()
        if scan.t_ns < device.newest_ns - _CLOCK_RESTART_NS:  # its clock restarted
            device = _DeviceState()
        self._devices[scan.device] = device
        if len(self._devices) > _MAX_DEVICES:
            self._devices.popitem(last=False)
        window = device.scans.window(scan, self._fingerprint.window)
        state = self._fingerprint.start() if device.state is None else device.state
        device.state, observation = self._fingerprint.step(state, window)
        device.scans.add(scan)
        device.newest_ns = max(device.newest_ns, scan.t_ns)
        device.scans.forget_before(device.newest_ns)
        fix: Fix | None = observation.fix
        return fix


class FixService:
    """Takes the scans that an engine took in from its follow port, and sends it fixes.

    Args:
        stage: the fingerprint.
        follow: address of the engine's follow port.
        to: the engine's sensors port.
        keys: for both.
    """

    def __init__(self, stage: Stage, follow: str, to: str, *, keys: Keys | None = None) -> None:
        """Connect; the engine need not be running yet."""
        self._locator = StatefulLocator(stage)
        self._label = stage.label
        self._to = to
        self._keys = keys
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._context.set(zmq.MAX_SOCKETS, 4 * _MAX_DEVICES)
        self._sensors: OrderedDict[str, Sensor] = OrderedDict()
        self._socket = open_client_socket(zmq.SUB, keys, self._context)
        self._socket.subscribe(b"event")
        connect_socket(self._socket, follow)
        self._stopping = False
        self.counts: Counter[str] = Counter()

    def serve(self) -> None:
        """Run until stopped."""
        try:
            while not self._stopping:
                if self._socket.poll(_IDLE_MS):
                    self._handle_record(self._socket.recv_multipart())
                else:
                    for sensor in self._sensors.values():
                        sensor.flush(0.0)
        finally:
            for sensor in self._sensors.values():
                sensor.flush(1.0)
                sensor.close()
            self._socket.close()
            self._context.term()

    def stop(self) -> None:
        """Stop soon; from any thread."""
        self._stopping = True

    def _handle_record(self, frames: list[bytes]) -> None:
        try:
            event = decode_event(frames[-1])
        except (WireError, msgspec.MsgspecError) as error:
            self.counts["malformed"] += 1
            _LOGGER.warning("a record that cannot be used: %s", error, extra={"code": "record_malformed"})
            return
        if not isinstance(event, Scan):
            return
        self.counts["scans"] += 1
        try:
            fix = self._locator.locate(event)
        except Exception as error:  # noqa: BLE001 - one scan that cannot be located must not keep others from it
            self.counts["failed"] += 1
            _LOGGER.warning(
                "%s: %s: %s",
                self._label,
                type(error).__name__,
                error,
                extra={"code": "stage_failed", "device": event.device},
            )
            return
        if fix is None:
            self.counts["no fix"] += 1
            return
        self.counts["fixes"] += 1
        self._sensor(event.device).fix(fix.t_ns, fix.floor, fix.xy, covariance=fix.covariance, source=fix.source)

    def _sensor(self, device: str) -> Sensor:
        sensor = self._sensors.pop(device, None)
        if sensor is None:
            dropped = self._dropped
            sensor = Sensor(
                self._to,
                device,
                keys=self._keys,
                send_hello=False,
                on_drop=dropped,
                buffer_messages=1_000,
                context=self._context,
            )
        self._sensors[device] = sensor
        if len(self._sensors) > _MAX_DEVICES:
            _, oldest = self._sensors.popitem(last=False)
            oldest.close()
        return sensor

    def _dropped(self, _: int) -> None:
        self.counts["dropped"] += 1
