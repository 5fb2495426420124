"""The ports of an engine as a process of its own: says where it is, accepts all, counts, ends with its input."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from ports_lab import Loop, free_ports

from tickfix.ports import Hub, Publication


def main() -> None:
    """Serve until standard input ends, then print the books."""
    hub = Hub(free_ports(), run="run-1", site="office", describe=lambda what, args: {"what": what})
    addresses = hub.start()
    where = {"sensors": addresses.sensors, "positions": addresses.positions, "control": addresses.control}
    sys.stdout.write(json.dumps(where) + "\n")
    sys.stdout.flush()
    hub.publish([Publication("estimate", "office", "F1", "p", "fusion", b"body")])
    loop = Loop(hub)
    thread = threading.Thread(target=loop.run)
    thread.start()
    sys.stdin.read()
    loop.ended.set()
    thread.join()
    counters = hub.counters()
    hub.stop()
    sys.stdout.write(json.dumps(counters) + "\n")


if __name__ == "__main__":
    main()
