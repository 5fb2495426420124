"""State kept per peer (identity, token buckets, counters) and per device (which peer sends for it)."""

from __future__ import annotations

import hashlib
import secrets
from collections import Counter, OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import zmq

from tickfix.ports.authentication import AllowList, KeyGrant
from tickfix.ports.port_settings import PeerLimits
from tickfix.wire import ReplyOutcome


class TokenBucket:
    """What a peer may still send now: a bucket of messages and one of bytes, both full at the beginning.

    A message that is refused costs nothing, so that a peer that slows down is accepted again without delay.
    """

    __slots__ = ("_at_ns", "_bytes", "_messages", "limits")

    def __init__(self, limits: PeerLimits, now_ns: int) -> None:
        """Begin with full buckets at ``now_ns`` of a monotonic clock."""
        self.limits = limits
        self._at_ns = now_ns
        self._messages = float(limits.message_burst)
        self._bytes = float(limits.byte_burst)

    def try_consume(self, n_bytes: int, now_ns: int) -> bool:
        """Take a message of ``n_bytes`` out of the buckets, or return False if they do not hold enough."""
        limits = self.limits
        elapsed_s = (now_ns - self._at_ns) / 1e9
        if elapsed_s > 0.0:
            self._at_ns = now_ns
            self._messages = min(self._messages + elapsed_s * limits.messages_per_s, limits.message_burst)
            self._bytes = min(self._bytes + elapsed_s * limits.bytes_per_s, limits.byte_burst)
        if self._messages < 1.0 or self._bytes < n_bytes:
            return False
        self._messages -= 1.0
        self._bytes -= n_bytes
        return True


_MAX_PEERS: Final = 4_096
_REVOKED_KEYS: Final = "(withdrawn keys)"
"""The account of all whose key was taken off the list; no key can have a name with these brackets."""


class PeerState:
    """What is known of one peer: its limits, its counters, and how much of it waits for the loop.

    Attributes:
        name: the key's name where CURVE is on, the connection's otherwise.
        grant: the key's entry on the allow-list; None without CURVE.
        bucket: what it may still send now.
        limits: its limits.
        received, received_bytes: messages that came in.
        outcomes: what became of them.
        waiting, waiting_bytes: how much of it is in the queue to the loop.
        throttle_notice_ns: when the last notice of throttling was sent to it.
    """

    __slots__ = (
        "bucket",
        "grant",
        "limits",
        "name",
        "outcomes",
        "received",
        "received_bytes",
        "throttle_notice_ns",
        "waiting",
        "waiting_bytes",
    )

    def __init__(self, name: str, grant: KeyGrant | None, limits: PeerLimits, now_ns: int) -> None:
        """Open the account with full buckets."""
        self.name = name
        self.grant = grant
        self.limits = limits
        self.bucket = TokenBucket(limits, now_ns)
        self.received = 0
        self.received_bytes = 0
        self.outcomes: Counter[ReplyOutcome] = Counter()
        self.waiting = 0
        self.waiting_bytes = 0
        self.throttle_notice_ns = -(2**62)


@dataclass(frozen=True, slots=True)
class Peer:
    """Where one message came from, and so where its answer goes.

    Attributes:
        state: of its key or connection.
        routing_id: libzmq's name of the connection.
        delimited: an empty frame stood before the message, as REQ does; the answer gets one too.
        allowed: its key is on the allow-list, or there is none.
    """

    state: PeerState
    routing_id: bytes
    delimited: bool
    allowed: bool = True

    @property
    def name(self) -> str:
        """The key's name where CURVE is on, the connection's otherwise."""
        return self.state.name

    def envelope(self, body: bytes) -> list[bytes]:
        """Return the frames that bring ``body`` to it."""
        return [self.routing_id, b"", body] if self.delimited else [self.routing_id, body]


class PeerRegistry:
    """The accounts of those heard most recently."""

    def __init__(self, defaults: PeerLimits, allowed: AllowList | None) -> None:
        """Give accounts ``defaults`` limits unless the allow-list has others."""
        self._defaults = defaults
        self._allowed = allowed
        self._salt = secrets.token_bytes(16)
        self._states: OrderedDict[str, PeerState] = OrderedDict()
        self._names: dict[bytes, str] = {}

    def __iter__(self) -> Iterator[PeerState]:
        """Iterate over the accounts, the one heard last at the end."""
        return iter(tuple(self._states.values()))

    def identify(self, identity: zmq.Frame, *, delimited: bool, now_ns: int) -> Peer:
        """Return the peer whose message begins with the frame ``identity``, its routing id."""
        routing_id = identity.bytes
        if self._allowed is None:
            return Peer(self._state_for(self._connection_name(routing_id), None, now_ns), routing_id, delimited)
        grant = self._allowed.grant_for_key(_authenticated_key(identity))
        state = self._state_for(_REVOKED_KEYS if grant is None else grant.name, grant, now_ns)
        return Peer(state, routing_id, delimited, grant is not None)

    def _connection_name(self, routing_id: bytes) -> str:
        name = self._names.get(routing_id)
        if name is None:
            # Not the routing id itself: who knows another's could push it off, and names are shown to all who ask.
            digest = hashlib.blake2s(routing_id, key=self._salt, digest_size=6).hexdigest()
            if len(self._names) >= _MAX_PEERS:
                self._names.clear()
            name = self._names[routing_id] = f"connection-{digest}"
        return name

    def _state_for(self, name: str, grant: KeyGrant | None, now_ns: int) -> PeerState:
        state = self._states.get(name)
        if state is None:
            if len(self._states) >= _MAX_PEERS:
                self._states.popitem(last=False)
            state = self._states[name] = PeerState(name, grant, self._limits(grant), now_ns)
        else:
            self._states.move_to_end(name)
            if state.grant is not grant:
                state.grant, state.limits = grant, self._limits(grant)
                state.bucket = TokenBucket(state.limits, now_ns)
        return state

    def _limits(self, grant: KeyGrant | None) -> PeerLimits:
        return self._defaults if grant is None else grant.limits(self._defaults)


def _authenticated_key(frame: zmq.Frame) -> str:
    """Return the key with which the authenticator admitted the connection of this frame."""
    try:
        return str(frame.get("User-Id"))
    except zmq.ZMQError:
        return ""


_EVICTION_INTERVAL_NS: Final = 1_000_000_000


@dataclass(slots=True)
class _DeviceSession:
    peer: str
    session: str
    last_seen_ns: int
    sensor: bool


@dataclass(frozen=True, slots=True)
class AdmissionRefusal:
    """Why a message is refused: its outcome, and the text of its error."""

    outcome: ReplyOutcome
    field: str
    found: str
    expected: str


class DeviceSessions:
    """Remembers which peer speaks for which device.

    The peer that sends ``hello`` owns the device from then on: the last one wins, because a phone that reconnects
    cannot be told from a stranger, and locking the phone out would be worse. Without ``hello``,
    another peer takes over when it continues the session (its name is known to the two ends only), or when the device
    was silent for a while. Positions computed elsewhere and truth may come from anyone who may speak for the device at
    all: they are no voice of the device.
    """

    def __init__(self, max_devices: int, takeover_ns: int, idle_ns: int) -> None:
        """Allow ``max_devices`` devices in all."""
        self._max_devices = max_devices
        self._takeover_ns = takeover_ns
        self._idle_ns = idle_ns
        self._sessions: dict[str, _DeviceSession] = {}
        self._devices_per_peer: Counter[str] = Counter()
        self._last_eviction_ns = -_EVICTION_INTERVAL_NS

    def __len__(self) -> int:
        """Return the number of devices."""
        return len(self._sessions)

    def __contains__(self, device: str) -> bool:
        """Whether somebody speaks for the device."""
        return device in self._sessions

    def count_of_peer(self, peer: str) -> int:
        """Return for how many devices a peer speaks."""
        return self._devices_per_peer[peer]

    def admit(
        self, device: str, session: str, peer: str, *, limit: int, now_ns: int, hello: bool = False, sensor: bool = True
    ) -> AdmissionRefusal | None:
        """Let ``peer`` send for ``device``, or return why not.

        Args:
            device: whose message it is.
            session: of the message.
            peer: who sent it.
            limit: for how many devices this peer may speak.
            now_ns: monotonic clock.
            hello: the message opens a session.
            sensor: the message is the device's own voice.
        """
        current = self._sessions.get(device)
        if current is None:
            return self._open_session(device, session, peer, limit, now_ns, sensor=sensor)
        if current.peer == peer or not sensor:
            if sensor:
                current.session, current.sensor = session, True
            if sensor or not current.sensor:
                current.last_seen_ns = now_ns
            return None
        continues = session != "" and session == current.session
        silent = now_ns - current.last_seen_ns > self._takeover_ns
        if not (hello or continues or silent or not current.sensor):
            expected = "one sender at a time: a hello, or the session that is under way"
            return AdmissionRefusal(
                ReplyOutcome.UNAUTHORISED, "device", f"{device!r}, for which another peer speaks", expected
            )
        if self._devices_per_peer[peer] >= limit:
            return _too_many_devices(limit)
        self._release_slot(current.peer)
        self._devices_per_peer[peer] += 1
        self._sessions[device] = _DeviceSession(peer, session, now_ns, sensor)
        return None

    def forget(self, device: str) -> None:
        """Free the device's place."""
        current = self._sessions.pop(device, None)
        if current is not None:
            self._release_slot(current.peer)

    def _open_session(
        self, device: str, session: str, peer: str, limit: int, now_ns: int, *, sensor: bool
    ) -> AdmissionRefusal | None:
        if self._devices_per_peer[peer] >= limit or len(self._sessions) >= self._max_devices:
            self._evict_idle(now_ns)
        if self._devices_per_peer[peer] >= limit:
            return _too_many_devices(limit)
        if len(self._sessions) >= self._max_devices:
            found = f"{device!r}, a new device, while there are {len(self._sessions)}"
            return AdmissionRefusal(ReplyOutcome.BUSY, "device", found, f"at most {self._max_devices} devices in all")
        self._sessions[device] = _DeviceSession(peer, session, now_ns, sensor)
        self._devices_per_peer[peer] += 1
        return None

    def _evict_idle(self, now_ns: int) -> None:
        if now_ns - self._last_eviction_ns < _EVICTION_INTERVAL_NS:
            return
        self._last_eviction_ns = now_ns
        idle = [device for device, s in self._sessions.items() if now_ns - s.last_seen_ns > self._idle_ns]
        for device in idle:
            self.forget(device)

    def _release_slot(self, peer: str) -> None:
        self._devices_per_peer[peer] -= 1
        if self._devices_per_peer[peer] <= 0:
            del self._devices_per_peer[peer]


def _too_many_devices(limit: int) -> AdmissionRefusal:
    return AdmissionRefusal(
        ReplyOutcome.BUSY, "device", f"one more than {limit} devices", f"at most {limit} devices of one peer"
    )
