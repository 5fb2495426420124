"""Sockets as the ports want them: bounded, watched, and closed without waiting."""

from __future__ import annotations

import ctypes
import errno
import secrets
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final, cast

import zmq

from tickfix.api.errors import PortError
from tickfix.ports.addresses import Address, check_free
from tickfix.ports.holders import holder_of
from tickfix.ports.keys import KeyPair

OLDEST: Final = (4, 3, 4)
"""libzmq before 4.3.4 has holes that a stranger can reach: CVE-2019-6250 (fixed in 4.3.1), CVE-2019-13132 (4.3.2),
CVE-2020-15166 and CVE-2021-20234 to 20237 (4.3.3), CVE-2020-36400 (4.3.4)."""

_HANDSHAKE_MS: Final = 5_000


def check_libzmq(version: tuple[int, ...], *, curve: bool = True) -> None:
    """Refuse a libzmq with known holes, or one that cannot encrypt where that is asked.

    Raises:
        PortError: with the versions found and expected.
    """
    if version < OLDEST:
        found = ".".join(map(str, version))
        raise PortError(f"libzmq {found} has known holes (CVE-2020-36400 and older); install pyzmq with 4.3.4 or newer")
    if not curve:
        raise PortError("this libzmq was built without CURVE, so keys cannot be used; install pyzmq from its wheels")


def raise_file_limit() -> None:
    """Let this process have as many file descriptors as it may: whoever connects takes one, before any handshake."""
    with suppress(ImportError, ValueError, OSError):
        import resource  # noqa: PLC0415 - not there on all systems

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft != hard:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def open_socket(context: zmq.Context[Any], kind: int, *, queued: int, frame_bytes: int) -> zmq.Socket[bytes]:
    """Make a socket with the options that every port shares.

    Args:
        context: the hub's.
        kind: such as ``zmq.ROUTER``.
        queued: how many messages wait at most, for each peer and direction; what is beyond is dropped when it goes
            out, and held back by TCP when it comes in.
        frame_bytes: libzmq cuts off whoever sends a longer frame.
    """
    socket: zmq.Socket[bytes] = context.socket(kind)
    options: Mapping[int, int] = {
        zmq.LINGER: 0,
        zmq.SNDHWM: queued,
        zmq.RCVHWM: queued,
        zmq.MAXMSGSIZE: frame_bytes,
        zmq.HANDSHAKE_IVL: _HANDSHAKE_MS,
        # No ZMTP heartbeats from here: libzmq up to 4.3.5 aborts the process when one is due on a connection that broke
        # while its queue was full (libzmq issues 3937, 4364, 4767). A flood that is killed is all it takes. So it is
        # TCP that finds out about a phone that went out of reach, within a minute.
        zmq.TCP_KEEPALIVE: 1,
        zmq.TCP_KEEPALIVE_IDLE: 30,
        zmq.TCP_KEEPALIVE_INTVL: 10,
        zmq.TCP_KEEPALIVE_CNT: 3,
    }
    for option, value in options.items():
        socket.setsockopt(option, value)
    return socket


def open_router(context: zmq.Context[Any], *, queued: int, frame_bytes: int) -> zmq.Socket[bytes]:
    """Make a ROUTER that says when an answer cannot be delivered, and lets a peer come back under its own name.

    MANDATORY: an answer to a peer that left, or does not read, is an error that can be counted, not a silent loss.
    HANDOVER: a phone that chose its routing id and changed its network would otherwise be ignored for as long as its
    old connection looks alive. The price is that a peer may push another off whose id it knows; ids that libzmq gives
    out are told to nobody and begin anywhere, see :func:`scatter_routing_ids`.
    """
    scatter_routing_ids()
    socket = open_socket(context, zmq.ROUTER, queued=queued, frame_bytes=frame_bytes)
    socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
    socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
    return socket


def scatter_routing_ids() -> None:
    """Let the routing ids that libzmq gives to connections begin anywhere.

    libzmq 4.3.5 takes the first from ``rand`` of the C library, which it never seeds, and counts up. It also believes
    any id that a peer claims: one that claims the id given out next aborts the whole process at the next connection
    (``Assertion failed: ok (src/socket_base.cpp)``). So nobody may be able to tell which is next.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).srand(secrets.randbits(32))


def demand_keys(socket: zmq.Socket[bytes], port: str, engine: KeyPair) -> None:
    """Let in only peers that speak CURVE and that the doorkeeper admits to ``port``."""
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, engine.secret.encode("ascii"))
    socket.setsockopt(zmq.ZAP_DOMAIN, port.encode("ascii"))
    socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)


def bind(socket: zmq.Socket[bytes], where: str, address: Address, *, private: bool) -> str:
    """Bind and return the endpoint in full.

    Args:
        socket: to bind.
        where: setting that named the address, for errors.
        address: where.
        private: an ``ipc`` file is for this user only.

    Raises:
        PortError: naming address, cause and who may hold it.
    """
    check_free(where, address)
    if address.ipv6:
        socket.setsockopt(zmq.IPV6, 1)
    try:
        socket.bind(address.endpoint)
        if private and address.path is not None:
            address.path.chmod(0o600)
    except (zmq.ZMQError, OSError) as error:
        if error.errno == errno.EADDRINUSE:
            raise PortError(f"{where}: {address.endpoint} is in use: {holder_of(address.port)}") from error
        hint = {
            errno.ENODEV: "no interface of this machine has that address",
            errno.EADDRNOTAVAIL: "no interface of this machine has that address",
            errno.EACCES: "not permitted to this user",
        }.get(error.errno or 0, str(error.strerror))
        raise PortError(f"{where}: {address.endpoint} cannot be bound: {hint}") from error
    return endpoint_of(socket)


def endpoint_of(socket: zmq.Socket[bytes]) -> str:
    """Return where a bound socket is, in full."""
    return cast(bytes, socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()
