"""Who may come in: libzmq asks at every handshake (ZAP, RFC 27), and the allow-list answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import zmq
import zmq.utils.z85

from tickfix.api.errors import PortError
from tickfix.ports.keys import ALLOWED, Grant, read_grants

ENDPOINT: Final = "inproc://zeromq.zap.01"


class AllowList:
    """The allow-list as its file says now.

    Attributes:
        problem: why the file as it is now cannot be used; while there is one, the last good list counts.
    """

    def __init__(self, folder: Path) -> None:
        """Read the list in ``folder``.

        Raises:
            PortError: when it cannot be used.
        """
        self._file = folder / ALLOWED
        self._stamp = self._look()
        self._lost: set[str] = set()
        self._set(read_grants(self._file))
        self.problem = ""

    def refresh(self) -> None:
        """Read the file again if it changed."""
        stamp = self._look()
        if stamp == self._stamp:
            return
        self._stamp = stamp
        try:
            grants = read_grants(self._file)
        except PortError as error:
            self.problem = str(error)
            return
        self.problem = ""
        before = self._by_key
        self._set(grants)
        now = {key: grant.ports for key, grant in self._by_key.items()}
        self._lost |= {port for key, grant in before.items() for port in grant.ports if port not in now.get(key, ())}

    def take_lost(self) -> frozenset[str]:
        """Return the ports that some key may use no longer, since this was last asked."""
        lost, self._lost = frozenset(self._lost), set()
        return lost

    def of_key(self, key: str) -> Grant | None:
        """Return the entry of this public key."""
        return self._by_key.get(key)

    def __len__(self) -> int:
        """Return the number of keys."""
        return len(self._by_key)

    def _set(self, grants: Sequence[Grant]) -> None:
        self._by_key: Mapping[str, Grant] = {grant.key: grant for grant in grants}

    def _look(self) -> tuple[int, int, int] | None:
        try:
            stat = self._file.stat()
        except OSError:
            return None
        return stat.st_mtime_ns, stat.st_size, stat.st_ino


class Doorkeeper:
    """Answers libzmq's questions about who may connect to which port.

    Attributes:
        refused: handshakes refused, by port; whoever is refused never gets to send a message.
        admitted: handshakes admitted, by port.
    """

    def __init__(self, socket: zmq.Socket[bytes], allowed: AllowList) -> None:
        """Serve ``socket``, a REP bound to :data:`ENDPOINT`."""
        self._socket = socket
        self._allowed = allowed
        self.refused: Counter[str] = Counter()
        self.admitted: Counter[str] = Counter()

    def serve(self, most: int = 64) -> None:
        """Answer what was asked, at most ``most`` questions."""
        for _ in range(most):
            try:
                frames = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._socket.send_multipart(self._safe_answer(frames))

    def _safe_answer(self, frames: Sequence[bytes]) -> list[bytes]:
        """Answer whatever happens: a question without an answer would be the last one that libzmq asks."""
        try:
            return self._answer(frames)
        except Exception as problem:  # noqa: BLE001 - see above
            self.refused[f"{type(problem).__name__}: {problem}"[:200]] += 1
            request = frames[1] if len(frames) > 1 else b""
            return [b"1.0", request, b"500", b"the engine cannot tell", b"", b""]

    def _answer(self, frames: Sequence[bytes]) -> list[bytes]:
        version, request = frames[0], frames[1] if len(frames) > 1 else b""
        port = frames[2].decode(errors="replace") if len(frames) > 2 else ""
        grant = None
        if version == b"1.0" and len(frames) == 7 and frames[5] == b"CURVE" and len(frames[6]) == 32:
            key = zmq.utils.z85.encode(frames[6]).decode("ascii")
            # As the list is at this instant: a client that is refused does not come back by itself.
            self._allowed.refresh()
            grant = self._allowed.of_key(key)
        if grant is None or port not in grant.ports:
            self.refused[port] += 1
            return [b"1.0", request, b"400", b"not on the allow-list for this port", b"", b""]
        self.admitted[port] += 1
        # The key itself is the name that libzmq notes on every message: should the key be withdrawn, or exchanged
        # under the same name, then connections made with it count for nothing at once.
        return [b"1.0", request, b"200", b"OK", grant.key.encode("ascii"), b""]
