"""Addresses and ZeroMQ sockets of the ports: parsing, options, binding, reopening, closing."""

from __future__ import annotations

import ctypes
import errno
import ipaddress
import re
import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from socket import SOCK_STREAM
from socket import socket as UnixSocket  # noqa: N812 - a socket here is ZeroMQ's
from typing import Any, Final, cast

import zmq

from tickfix.api.errors import ConfigError, PortError
from tickfix.ports.authentication import ENGINE_KEY_NAME, PORT_NAMES, ZAP_ENDPOINT, KeyPair, read_key_pair
from tickfix.ports.port_settings import PortSettings

_TCP_PATTERN: Final = re.compile(r"tcp://(?P<host>\[[^\]]+\]|[^:\[\]/]+):(?P<port>\*|\d{1,5})")
_ADDRESS_FORMAT: Final = "tcp://HOST:PORT or ipc://PATH, such as tcp://127.0.0.1:5571"
_MAX_IPC_PATH_BYTES: Final = 107


@dataclass(frozen=True, slots=True)
class PortAddress:
    """A checked address.

    Attributes:
        endpoint: as libzmq takes it.
        local: it cannot be reached from another machine.
        ipv6: the host is an IPv6 address.
        path: file of an ``ipc`` address; None otherwise, and in Linux's abstract namespace.
        port: TCP port, 0 for any free one and for ``ipc``.
    """

    endpoint: str
    local: bool
    ipv6: bool = False
    path: Path | None = None
    port: int = 0


def parse_address(where: str, text: str) -> PortAddress:
    """Return the address that ``text`` means; ``where`` names the setting in errors.

    Raises:
        ConfigError: when it is neither ``tcp`` with host and port nor ``ipc`` with a path.
    """
    if text.startswith("ipc://"):
        return _parse_ipc(where, text)
    match = _TCP_PATTERN.fullmatch(text)
    if match is None:
        raise ConfigError(where, repr(text), _ADDRESS_FORMAT)
    port = 0 if match["port"] == "*" else int(match["port"])
    if port > 65_535:
        raise ConfigError(where, repr(text), "a port up to 65535")
    # libzmq binds to numbers and interfaces only, never to names.
    host = "127.0.0.1" if match["host"] == "localhost" else match["host"]
    endpoint = f"tcp://{host}:{port or '*'}"
    try:
        ip = ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return PortAddress(endpoint, local=False, port=port)
    return PortAddress(endpoint, local=ip.is_loopback, ipv6=ip.version == 6, port=port)


def require_keys_unless_local(where: str, address: PortAddress) -> None:
    """Refuse to be reached from other machines without keys.

    Raises:
        ConfigError: with the command that makes keys.
    """
    if not address.local:
        raise ConfigError(
            where,
            f"{address.endpoint}, which other machines can reach, and no keys",
            'keys: run `tickfix keys new engine --folder keys`, set ports.keys = "keys"; or an address on 127.0.0.1',
        )


def check_ipc_path_free(where: str, address: PortAddress) -> None:
    """Refuse an ``ipc`` path that somebody listens on, or that is no socket.

    libzmq would silently take it away from them, and delete whatever file is there.

    Raises:
        PortError: when it is taken.
    """
    path = address.path
    if path is None:
        return
    if not path.parent.is_dir():
        raise PortError(f"{where}: {address.endpoint} cannot be bound: there is no folder {path.parent}")
    if path.exists() and not path.is_socket():
        raise PortError(f"{where}: {address.endpoint} cannot be bound: {path} is a file, and it is left alone")
    from socket import AF_UNIX  # noqa: PLC0415 - not there on all systems

    with UnixSocket(AF_UNIX, SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (FileNotFoundError, ConnectionRefusedError):
            return
        except OSError as error:
            raise PortError(f"{where}: {address.endpoint} cannot be bound: {error}") from error
    raise PortError(f"{where}: {address.endpoint} is taken: a process listens there; is another tickfix running?")


def _parse_ipc(where: str, text: str) -> PortAddress:
    name = text.removeprefix("ipc://")
    if not name or name == "*" or len(name.encode()) > _MAX_IPC_PATH_BYTES:
        raise ConfigError(where, repr(text), f"ipc://PATH of 1 to {_MAX_IPC_PATH_BYTES} bytes")
    return PortAddress(text, local=True, path=None if name.startswith("@") else Path(name))


_TCP_LISTEN_STATE: Final = "0A"


def find_listening_process(port: int) -> str:
    """Name the process that listens on a TCP port of this machine, as far as this user may see it."""
    inodes = _listening_inodes(port)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if any(fd.readlink().name in inodes for fd in (folder / "fd").iterdir()):
                command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
                return f"process {folder.name} ({command:.120}) holds it"
    return f"another process holds it, perhaps another tickfix serve; `ss -ltnp sport = :{port}` shows which"


def _listening_inodes(port: int) -> set[str]:
    """Return the sockets that listen on the port as they stand in ``/proc/PID/fd``; empty where there is no /proc."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        with suppress(OSError):
            for line in Path(table).read_text(encoding="ascii").splitlines()[1:]:
                columns = line.split()
                if columns[3] == _TCP_LISTEN_STATE and int(columns[1].rpartition(":")[2], 16) == port:
                    found.add(f"socket:[{columns[9]}]")
    return found


OLDEST_LIBZMQ: Final = (4, 3, 4)
"""libzmq before 4.3.4 has holes that a stranger can reach: CVE-2019-6250 (fixed in 4.3.1), CVE-2019-13132 (4.3.2),
CVE-2020-15166 and CVE-2021-20234 to 20237 (4.3.3), CVE-2020-36400 (4.3.4)."""

_HANDSHAKE_TIMEOUT_MS: Final = 5_000


def check_libzmq(version: tuple[int, ...], *, curve: bool = True) -> None:
    """Refuse a libzmq with known holes, or one that cannot encrypt where that is asked.

    Raises:
        PortError: with the versions found and expected.
    """
    if version < OLDEST_LIBZMQ:
        found = ".".join(map(str, version))
        raise PortError(f"libzmq {found} has known holes (CVE-2020-36400 and older); install pyzmq with 4.3.4 or newer")
    if not curve:
        raise PortError("this libzmq was built without CURVE, so keys cannot be used; install pyzmq from its wheels")


def raise_file_limit() -> None:
    """Let this process have as many file descriptors as it may: every connection takes one, before any handshake."""
    with suppress(ImportError, ValueError, OSError):
        import resource  # noqa: PLC0415 - not there on all systems

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft != hard:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def open_port_socket(
    context: zmq.Context[Any], kind: int, *, high_water_mark: int, frame_bytes: int
) -> zmq.Socket[bytes]:
    """Make a socket with the options that every port shares.

    Args:
        context: the hub's.
        kind: such as ``zmq.ROUTER``.
        high_water_mark: how many messages wait at most, for each peer and direction; what is beyond is dropped when it
            goes
            out, and held back by TCP when it comes in.
        frame_bytes: libzmq disconnects a peer that sends a longer frame.
    """
    socket: zmq.Socket[bytes] = context.socket(kind)
    options: Mapping[int, int] = {
        zmq.LINGER: 0,
        zmq.SNDHWM: high_water_mark,
        zmq.RCVHWM: high_water_mark,
        zmq.MAXMSGSIZE: frame_bytes,
        zmq.HANDSHAKE_IVL: _HANDSHAKE_TIMEOUT_MS,
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


def open_router_socket(context: zmq.Context[Any], *, high_water_mark: int, frame_bytes: int) -> zmq.Socket[bytes]:
    """Make a ROUTER that raises when an answer cannot be delivered, and lets a peer come back under its own name.

    MANDATORY: an answer to a peer that left, or does not read, is an error that can be counted, not a silent loss.
    HANDOVER: a phone that chose its routing id and changed its network would otherwise be ignored for as long as its
    old connection looks alive. The price is that a peer may push another off whose id it knows; ids that libzmq gives
    out are told to nobody and begin anywhere, see :func:`randomise_routing_ids`.
    """
    randomise_routing_ids()
    socket = open_port_socket(context, zmq.ROUTER, high_water_mark=high_water_mark, frame_bytes=frame_bytes)
    socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
    socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
    return socket


def randomise_routing_ids() -> None:
    """Let the routing ids that libzmq gives to connections begin anywhere.

    libzmq 4.3.5 takes the first from ``rand`` of the C library, which it never seeds, and counts up. It also believes
    any id that a peer claims: one that claims the id given out next aborts the whole process at the next connection
    (``Assertion failed: ok (src/socket_base.cpp)``). So the next one must not be predictable.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).srand(secrets.randbits(32))


def require_curve(socket: zmq.Socket[bytes], port: str, engine: KeyPair) -> None:
    """Let in only peers that speak CURVE and that the authenticator admits to ``port``."""
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, engine.secret.encode("ascii"))
    socket.setsockopt(zmq.ZAP_DOMAIN, port.encode("ascii"))
    socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)


def bind_socket(socket: zmq.Socket[bytes], where: str, address: PortAddress, *, private: bool) -> str:
    """Bind and return the endpoint in full.

    Args:
        socket: to bind.
        where: setting that named the address, for errors.
        address: where.
        private: an ``ipc`` file is for this user only.

    Raises:
        PortError: naming address, cause and who may hold it.
    """
    check_ipc_path_free(where, address)
    if address.ipv6:
        socket.setsockopt(zmq.IPV6, 1)
    try:
        socket.bind(address.endpoint)
        if private and address.path is not None:
            address.path.chmod(0o600)
    except (zmq.ZMQError, OSError) as error:
        if error.errno == errno.EADDRINUSE:
            raise PortError(f"{where}: {address.endpoint} is in use: {find_listening_process(address.port)}") from error
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


HIGH_WATER_MARKS: Final = {"sensors": 256, "positions": 10_000, "control": 64, "follow": 20_000}
"""High-water marks, messages per peer. What a sensor sends beyond them waits in its own connection."""

_MAX_SUBSCRIPTION_BYTES: Final = 4_096
_MAX_REQUEST_BYTES: Final = 65_536
_REBIND_ATTEMPTS: Final = 400
_REBIND_INTERVAL_S: Final = 0.005


class PortSockets:
    """The sockets by port name, with ``authenticator`` for the ZAP requests of libzmq if there are keys.

    Attributes:
        endpoints: where each port is, in full, once it is open.
    """

    def __init__(self, settings: PortSettings) -> None:
        """Check addresses and keys; nothing is opened yet.

        Raises:
            ConfigError: for an address that cannot be, or that others can reach while there are no keys.
            PortError: for keys that cannot be used.
        """
        self._settings = settings
        named = {name: getattr(settings, name) for name in PORT_NAMES}
        self._addresses = {name: parse_address(f"ports.{name}", text) for name, text in named.items() if text}
        if settings.keys is None:
            for name, address in self._addresses.items():
                require_keys_unless_local(f"ports.{name}", address)
        self._engine = None if settings.keys is None else read_key_pair(settings.keys / f"{ENGINE_KEY_NAME}.key")
        self._context: zmq.Context[Any] | None = None
        self._sockets: dict[str, zmq.Socket[bytes]] = {}
        self.endpoints: dict[str, str] = {}

    def __getitem__(self, name: str) -> zmq.Socket[bytes]:
        """Return the socket of a port."""
        return self._sockets[name]

    def __contains__(self, name: str) -> bool:
        """Whether there is such a port."""
        return name in self._addresses

    def open(self) -> None:
        """Open and bind all; when one cannot be bound, none stays open.

        Raises:
            PortError: naming address and cause.
        """
        raise_file_limit()
        self._context = zmq.Context()
        try:
            if self._engine is not None:
                self._sockets["authenticator"] = self._context.socket(zmq.REP)
                self._sockets["authenticator"].setsockopt(zmq.LINGER, 0)
                self._sockets["authenticator"].bind(ZAP_ENDPOINT)
            for name, address in self._addresses.items():
                self._sockets[name] = self._create_socket(self._context, name)
                self.endpoints[name] = self._bind(name, address)
        except BaseException:
            self.close(0)
            raise

    def reopen(self, name: str) -> zmq.Socket[bytes]:
        """Close a port and open it again; return its new socket.

        libzmq cannot cut off one connection. This cuts off all; those that may come back do so by themselves.

        Raises:
            PortError: when the address cannot be had again.
        """
        assert self._context is not None  # noqa: S101 - for the type checker: the ports are open
        old = self._sockets[name]
        old.unbind(endpoint_of(old))
        old.close(0)
        self._sockets[name] = self._create_socket(self._context, name)
        address = parse_address(f"ports.{name}", self.endpoints[name])
        for _ in range(_REBIND_ATTEMPTS):
            # The old socket gives its address back on a thread of libzmq's, in a moment.
            with suppress(PortError):
                self._bind(name, address)
                return self._sockets[name]
            time.sleep(_REBIND_INTERVAL_S)
        self._bind(name, address)
        return self._sockets[name]

    def close(self, linger_ms: int) -> None:
        """Give the addresses back and close all, after ``linger_ms`` for what is on its way."""
        # The authenticator was opened first and is closed last. Nothing is unbound beforehand: that ends connections,
        # with what they have not delivered. The addresses are free when the context has ended.
        for name, socket in reversed(self._sockets.items()):
            socket.close(linger_ms)
            address = self._addresses.get(name)
            if name in self.endpoints and address is not None and address.path is not None:
                address.path.unlink(missing_ok=True)
        self._sockets.clear()
        self.endpoints.clear()
        if self._context is not None:
            self._context.term()
            self._context = None

    def _create_socket(self, context: zmq.Context[Any], name: str) -> zmq.Socket[bytes]:
        """Return the socket of a port, not yet bound."""
        # One frame may be twice as long as a message may be, so that the first one that is too long gets an error.
        frame_bytes = {"sensors": 2 * self._settings.message.message_bytes, "control": _MAX_REQUEST_BYTES}
        if name in frame_bytes:
            socket = open_router_socket(context, high_water_mark=HIGH_WATER_MARKS[name], frame_bytes=frame_bytes[name])
        else:
            socket = open_port_socket(
                context, zmq.XPUB, high_water_mark=HIGH_WATER_MARKS[name], frame_bytes=_MAX_SUBSCRIPTION_BYTES
            )
        if self._engine is not None:
            require_curve(socket, name, self._engine)
        return socket

    def _bind(self, name: str, address: PortAddress) -> str:
        return bind_socket(self._sockets[name], f"ports.{name}", address, private=self._engine is None)
