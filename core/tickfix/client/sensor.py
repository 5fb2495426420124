"""What a device can say: its measurements as messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tickfix.client.arrays import float64s, int64s
from tickfix.client.connection import ClientError
from tickfix.client.session import Session


class Sensor(Session):
    """Sends what one device measures, in a session of its own: see :class:`Session` for its arguments and attributes.

    Arrays are lists, or anything that offers a buffer, such as arrays of numpy.
    """

    def motion(self, sensors: Mapping[str, tuple[Any, Any]]) -> int:
        """Send samples of motion sensors; return the message's number.

        Args:
            sensors: by sensor name, times in ns (n integers) and values (n rows); lists or arrays of numpy.

        Raises:
            ClientError: for times and values that do not fit together.
            OutboxFullError: see :class:`Session`.
        """
        batches = {}
        for name, (t_ns, values) in sensors.items():
            times, n = int64s(f"{name}.t_ns", t_ns)
            rows, m = float64s(f"{name}.values", values)
            if m % n if n else m:
                raise ClientError(f"{name}.values: found {m} numbers; expected a row for each of {n} times")
            batches[name] = {"t_ns": times, "values": rows}
        return self.send({"type": "motion", "sensors": batches})

    def scan(
        self, transmitters: list[str], rssi_dbm: Any, heard_ns: Any, *, t_ns: int | None = None, source: str = "wifi"
    ) -> int:
        """Send what a scan heard, each reading with its own time in ns; return the message's number.

        A scan that heard nothing needs its time ``t_ns``.

        Raises:
            ClientError, OutboxFullError: as :meth:`motion`.
        """
        (levels, n), (times, m) = float64s("rssi_dbm", rssi_dbm), int64s("heard_ns", heard_ns)
        if not len(transmitters) == n == m:
            raise ClientError(f"scan: found {len(transmitters)} transmitters, {n} levels, {m} times; expected as many")
        told = {} if t_ns is None else {"t_ns": t_ns}
        heard = {"transmitters": list(transmitters), "rssi_dbm": levels, "heard_ns": times, "source": source}
        return self.send({"type": "scan", **heard, **told})

    def pressure(self, t_ns: int, pressure_hpa: float) -> int:
        """Send one air pressure; return the message's number."""
        return self.send({"type": "pressure", "t_ns": t_ns, "pressure_hpa": float(pressure_hpa)})

    def fix(self, t_ns: int, floor: str, xy: Any, *, covariance: Any = None, source: str = "fix") -> int:
        """Send a position computed elsewhere, metres in the floor's frame, m²; return the message's number."""
        told = {} if covariance is None else {"covariance": float64s("covariance", covariance)[0]}
        place = {"t_ns": t_ns, "floor": floor, "xy": float64s("xy", xy)[0], "source": source}
        return self.send({"type": "fix", **place, **told})

    def truth(self, t_ns: int, floor: str, xy: Any) -> int:
        """Send where the device really is, for evaluation; return the message's number."""
        return self.send({"type": "truth", "t_ns": t_ns, "floor": floor, "xy": float64s("xy", xy)[0]})
