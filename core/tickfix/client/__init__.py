"""For programs that talk to an engine: a sensor, a listener, and control.

Imports pyzmq and msgpack and nothing else, neither numpy nor the rest of tickfix, so that it runs wherever these do.
The protocol is in ``docs/wire-protocol.md``. No class here starts a thread, and each object belongs to one thread::

    with Sensor("tcp://127.0.0.1:5571", "phone-17") as sensor:
        sensor.motion({"accelerometer": ([t_ns], [[0.0, 0.0, 9.81]])})
        sensor.scan(["aa:bb:cc:dd:ee:ff"], [-61.0], [t_ns])

    for estimate in Listener("tcp://127.0.0.1:5572", ["estimate/mall/"]):
        print(estimate["device"], estimate["belief"])

    print(Control("tcp://127.0.0.1:5573").status())
"""

from tickfix.client.connection import VERSION, AccessDeniedError, ClientError, Keys
from tickfix.client.control_client import Control, RequestRefusedError, RequestTimeoutError
from tickfix.client.listener import Listener
from tickfix.client.sensor import Sensor
from tickfix.client.session import BufferFullError

__all__ = [
    "VERSION",
    "AccessDeniedError",
    "BufferFullError",
    "ClientError",
    "Control",
    "Keys",
    "Listener",
    "RequestRefusedError",
    "RequestTimeoutError",
    "Sensor",
]
