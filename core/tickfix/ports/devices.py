"""Who speaks for which device: one peer at a time, so many devices a peer, and so many in all."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

from tickfix.kernel import Outcome

_LOOK_NS: Final = 1_000_000_000


@dataclass(slots=True)
class _Speaker:
    peer: str
    session: str
    heard_ns: int
    sensor: bool


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a message is not let in: its outcome, and what its error says."""

    outcome: Outcome
    field: str
    found: str
    expected: str


class Speakers:
    """Remembers which peer speaks for which device.

    Whoever says ``hello`` speaks for the device from then on: the last one wins, because a phone that comes back over
    a new connection cannot be told from a stranger, and locking the phone out would be worse. Without ``hello``,
    another peer takes over when it continues the session (its name is known to the two ends only), or when the device
    was silent for a while. Positions computed elsewhere and truth may come from anyone who may speak for the device at
    all: they are no voice of the device.
    """

    def __init__(self, most: int, takeover_ns: int, idle_ns: int) -> None:
        """Allow ``most`` devices in all."""
        self._most = most
        self._takeover_ns = takeover_ns
        self._idle_ns = idle_ns
        self._speakers: dict[str, _Speaker] = {}
        self._of_peer: Counter[str] = Counter()
        self._looked_ns = -_LOOK_NS

    def __len__(self) -> int:
        """Return the number of devices."""
        return len(self._speakers)

    def __contains__(self, device: str) -> bool:
        """Whether somebody speaks for the device."""
        return device in self._speakers

    def of_peer(self, peer: str) -> int:
        """Return for how many devices a peer speaks."""
        return self._of_peer[peer]

    def admit(
        self, device: str, session: str, peer: str, *, limit: int, now_ns: int, hello: bool = False, sensor: bool = True
    ) -> Refusal | None:
        """Let ``peer`` speak for ``device``, or say why not.

        Args:
            device: whose message it is.
            session: of the message.
            peer: who sent it.
            limit: for how many devices this peer may speak.
            now_ns: monotonic clock.
            hello: the message opens a session.
            sensor: the message is the device's own voice.
        """
        speaker = self._speakers.get(device)
        if speaker is None:
            return self._enter(device, session, peer, limit, now_ns, sensor=sensor)
        if speaker.peer == peer or not sensor:
            if sensor:
                speaker.session, speaker.sensor = session, True
            if sensor or not speaker.sensor:
                speaker.heard_ns = now_ns
            return None
        continues = session != "" and session == speaker.session
        silent = now_ns - speaker.heard_ns > self._takeover_ns
        if not (hello or continues or silent or not speaker.sensor):
            expected = "one speaker at a time: a hello, or the session that is under way"
            return Refusal(Outcome.UNAUTHORISED, "device", f"{device!r}, for which another peer speaks", expected)
        if self._of_peer[peer] >= limit:
            return _too_many(limit)
        self._release(speaker.peer)
        self._of_peer[peer] += 1
        self._speakers[device] = _Speaker(peer, session, now_ns, sensor)
        return None

    def forget(self, device: str) -> None:
        """Free the device's place."""
        speaker = self._speakers.pop(device, None)
        if speaker is not None:
            self._release(speaker.peer)

    def _enter(self, device: str, session: str, peer: str, limit: int, now_ns: int, *, sensor: bool) -> Refusal | None:
        if self._of_peer[peer] >= limit or len(self._speakers) >= self._most:
            self._drop_idle(now_ns)
        if self._of_peer[peer] >= limit:
            return _too_many(limit)
        if len(self._speakers) >= self._most:
            found = f"{device!r}, a new device, while there are {len(self._speakers)}"
            return Refusal(Outcome.BUSY, "device", found, f"at most {self._most} devices in all")
        self._speakers[device] = _Speaker(peer, session, now_ns, sensor)
        self._of_peer[peer] += 1
        return None

    def _drop_idle(self, now_ns: int) -> None:
        if now_ns - self._looked_ns < _LOOK_NS:
            return
        self._looked_ns = now_ns
        idle = [device for device, s in self._speakers.items() if now_ns - s.heard_ns > self._idle_ns]
        for device in idle:
            self.forget(device)

    def _release(self, peer: str) -> None:
        self._of_peer[peer] -= 1
        if self._of_peer[peer] <= 0:
            del self._of_peer[peer]


def _too_many(limit: int) -> Refusal:
    return Refusal(Outcome.BUSY, "device", f"one more than {limit} devices", f"at most {limit} devices of one peer")
