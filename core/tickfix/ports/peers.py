"""Who a message came from, and what is kept of everyone who was heard."""

from __future__ import annotations

import hashlib
import secrets
from collections import Counter, OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import zmq

from tickfix.kernel import Outcome
from tickfix.ports.authentication import AllowList
from tickfix.ports.keys import Grant
from tickfix.ports.limits import Allowance
from tickfix.ports.settings import PeerLimits

_REMEMBERED: Final = 4_096
_WITHDRAWN: Final = "(withdrawn keys)"
"""The account of all whose key was taken off the list; no key can have a name with these brackets."""


class Account:
    """What is known of one peer: its limits, its counters, and how much of it waits for the loop.

    Attributes:
        name: the key's name where CURVE is on, the connection's otherwise.
        grant: the key's entry on the allow-list; None without CURVE.
        allowance: what it may still send now.
        limits: its limits.
        received, received_bytes: messages that came in.
        outcomes: what became of them.
        waiting, waiting_bytes: how much of it is in the queue to the loop.
        told_ns: when it was last told that it is throttled.
    """

    __slots__ = (
        "allowance",
        "grant",
        "limits",
        "name",
        "outcomes",
        "received",
        "received_bytes",
        "told_ns",
        "waiting",
        "waiting_bytes",
    )

    def __init__(self, name: str, grant: Grant | None, limits: PeerLimits, now_ns: int) -> None:
        """Open the account with full buckets."""
        self.name = name
        self.grant = grant
        self.limits = limits
        self.allowance = Allowance(limits, now_ns)
        self.received = 0
        self.received_bytes = 0
        self.outcomes: Counter[Outcome] = Counter()
        self.waiting = 0
        self.waiting_bytes = 0
        self.told_ns = -(2**62)


@dataclass(frozen=True, slots=True)
class Peer:
    """Where one message came from, and so where its answer goes.

    Attributes:
        account: of its key or connection.
        routing_id: libzmq's name of the connection.
        delimited: an empty frame stood before the message, as REQ does; the answer gets one too.
        allowed: its key is on the allow-list, or there is none.
    """

    account: Account
    routing_id: bytes
    delimited: bool
    allowed: bool = True

    @property
    def name(self) -> str:
        """The key's name where CURVE is on, the connection's otherwise."""
        return self.account.name

    def envelope(self, body: bytes) -> list[bytes]:
        """Return the frames that bring ``body`` to it."""
        return [self.routing_id, b"", body] if self.delimited else [self.routing_id, body]


class Peers:
    """The accounts of those heard most recently."""

    def __init__(self, usual: PeerLimits, allowed: AllowList | None) -> None:
        """Give accounts ``usual`` limits where the allow-list does not say otherwise."""
        self._usual = usual
        self._allowed = allowed
        self._salt = secrets.token_bytes(16)
        self._accounts: OrderedDict[str, Account] = OrderedDict()
        self._names: dict[bytes, str] = {}

    def __iter__(self) -> Iterator[Account]:
        """Iterate over the accounts, the one heard last at the end."""
        return iter(tuple(self._accounts.values()))

    def of(self, head: zmq.Frame, *, delimited: bool, now_ns: int) -> Peer:
        """Return the peer whose message begins with the frame ``head``, its routing id."""
        routing_id = head.bytes
        if self._allowed is None:
            return Peer(self._account(self._name_of(routing_id), None, now_ns), routing_id, delimited)
        grant = self._allowed.of_key(_user_id(head))
        account = self._account(_WITHDRAWN if grant is None else grant.name, grant, now_ns)
        return Peer(account, routing_id, delimited, grant is not None)

    def _name_of(self, routing_id: bytes) -> str:
        name = self._names.get(routing_id)
        if name is None:
            # Not the routing id itself: who knows another's could push it off, and names are shown to all who ask.
            digest = hashlib.blake2s(routing_id, key=self._salt, digest_size=6).hexdigest()
            if len(self._names) >= _REMEMBERED:
                self._names.clear()
            name = self._names[routing_id] = f"connection-{digest}"
        return name

    def _account(self, name: str, grant: Grant | None, now_ns: int) -> Account:
        account = self._accounts.get(name)
        if account is None:
            if len(self._accounts) >= _REMEMBERED:
                self._accounts.popitem(last=False)
            account = self._accounts[name] = Account(name, grant, self._limits(grant), now_ns)
        else:
            self._accounts.move_to_end(name)
            if account.grant is not grant:
                account.grant, account.limits = grant, self._limits(grant)
                account.allowance = Allowance(account.limits, now_ns)
        return account

    def _limits(self, grant: Grant | None) -> PeerLimits:
        return self._usual if grant is None else grant.limits(self._usual)


def _user_id(frame: zmq.Frame) -> str:
    """Return the key that the doorkeeper admitted the connection of this frame with."""
    try:
        return str(frame.get("User-Id"))
    except zmq.ZMQError:
        return ""
