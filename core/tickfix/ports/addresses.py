"""Addresses: what can be bound, who can reach it, and who holds it already."""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tickfix.api.errors import ConfigError, PortError

_TCP: Final = re.compile(r"tcp://(?P<host>\[[^\]]+\]|[^:\[\]/]+):(?P<port>\*|\d{1,5})")
_EXPECTED: Final = "tcp://HOST:PORT or ipc://PATH, such as tcp://127.0.0.1:5571"
_PATH_BYTES: Final = 107


@dataclass(frozen=True, slots=True)
class Address:
    """A checked address.

    Attributes:
        endpoint: as libzmq takes it.
        local: nobody on another machine can reach it.
        ipv6: the host is an IPv6 address.
        path: file of an ``ipc`` address; None otherwise, and in Linux's abstract namespace.
        port: TCP port, 0 for any free one and for ``ipc``.
    """

    endpoint: str
    local: bool
    ipv6: bool = False
    path: Path | None = None
    port: int = 0


def parse_address(where: str, text: str) -> Address:
    """Return the address that ``text`` means; ``where`` names the setting in errors.

    Raises:
        ConfigError: when it is neither ``tcp`` with host and port nor ``ipc`` with a path.
    """
    if text.startswith("ipc://"):
        return _ipc(where, text)
    match = _TCP.fullmatch(text)
    if match is None:
        raise ConfigError(where, repr(text), _EXPECTED)
    port = 0 if match["port"] == "*" else int(match["port"])
    if port > 65_535:
        raise ConfigError(where, repr(text), "a port up to 65535")
    # libzmq binds to numbers and interfaces only, never to names.
    host = "127.0.0.1" if match["host"] == "localhost" else match["host"]
    endpoint = f"tcp://{host}:{port or '*'}"
    try:
        ip = ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return Address(endpoint, local=False, port=port)
    return Address(endpoint, local=ip.is_loopback, ipv6=ip.version == 6, port=port)


def require_keys(where: str, address: Address) -> None:
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


def check_free(where: str, address: Address) -> None:
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
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (FileNotFoundError, ConnectionRefusedError):
            return
        except OSError as error:
            raise PortError(f"{where}: {address.endpoint} cannot be bound: {error}") from error
    raise PortError(f"{where}: {address.endpoint} is taken: a process listens there; is another tickfix running?")


def _ipc(where: str, text: str) -> Address:
    name = text.removeprefix("ipc://")
    if not name or name == "*" or len(name.encode()) > _PATH_BYTES:
        raise ConfigError(where, repr(text), f"ipc://PATH of 1 to {_PATH_BYTES} bytes")
    return Address(text, local=True, path=None if name.startswith("@") else Path(name))
