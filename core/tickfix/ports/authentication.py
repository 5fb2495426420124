"""CURVE key files, the allow-list (reading and editing), and the ZAP authenticator (RFC 27) that applies it.

``NAME.key`` is a key pair, readable by its owner only; ``NAME.pub`` is its public half. The engine's own pair is called
``engine``. ``allowed.toml`` lists who may connect::

    [[allow]]
    name    = "phone-17"
    key     = "…its public key, 40 characters…"
    devices = ["phone-17"]          # globs; the devices it may send for
    ports   = ["sensors"]           # sensors, positions, control, follow"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import zmq
import zmq.utils.z85

from tickfix.api.errors import ConfigError, PortError
from tickfix.ports.port_settings import PeerLimits

ENGINE_KEY_NAME: Final = "engine"
ALLOW_LIST_FILE: Final = "allowed.toml"
PORT_NAMES: Final = ("sensors", "positions", "control", "follow")
_KEY_NAME_PATTERN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_KEY_NAME_RULE: Final = "letters, digits, _ and -, at most 64 of them, a letter or digit first"

_PositiveFloat = Annotated[float, msgspec.Meta(gt=0)]


class KeyGrant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a key may do.

    Attributes:
        name: of the key's owner; unique.
        key: public key, 40 characters of Z85.
        devices: globs of the devices it may speak for.
        ports: the ports it may use.
        messages_per_s, bytes_per_s, most_devices: in place of the limits in the settings.
    """

    name: str
    key: str
    devices: tuple[str, ...] = ()
    ports: tuple[str, ...] = ()
    messages_per_s: _PositiveFloat | None = None
    bytes_per_s: _PositiveFloat | None = None
    most_devices: Annotated[int, msgspec.Meta(gt=0)] | None = None

    def allows_device(self, device: str) -> bool:
        """Whether the key may speak for this device."""
        return any(fnmatchcase(device, glob) for glob in self.devices)

    def limits(self, defaults: PeerLimits) -> PeerLimits:
        """Return the limits for this key: the defaults, overridden by its entry."""
        messages_per_s = self.messages_per_s or defaults.messages_per_s
        bytes_per_s = self.bytes_per_s or defaults.bytes_per_s
        return replace(
            defaults,
            messages_per_s=messages_per_s,
            message_burst=max(defaults.message_burst, int(messages_per_s)),
            bytes_per_s=bytes_per_s,
            byte_burst=max(defaults.byte_burst, int(bytes_per_s)),
            devices=self.most_devices or defaults.devices,
        )


class _AllowListFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    allow: tuple[KeyGrant, ...] = ()


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A CURVE key pair, both halves as 40 characters of Z85."""

    public: str
    secret: str


def create_key_pair(name: str, folder: Path) -> Path:
    """Make a key pair in ``folder``; return the file of its public half.

    Raises:
        ConfigError: for a name that is no plain word.
        PortError: when there are such files already; they are left alone.
    """
    if _KEY_NAME_PATTERN.fullmatch(name) is None:
        raise ConfigError("name", repr(name), _KEY_NAME_RULE)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    public, secret = (half.decode("ascii") for half in zmq.curve_keypair())
    secret_file, public_file = folder / f"{name}.key", folder / f"{name}.pub"
    for file in (secret_file, public_file):
        if file.exists():
            raise PortError(f"{file} exists already and is left alone; choose another name, or remove it")
    # Exclusive, and private from its first instant on.
    descriptor = os.open(secret_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        stream.write(f'public = "{public}"\nsecret = "{secret}"\n')
    public_file.write_text(f'public = "{public}"\n', encoding="utf-8")
    return public_file


def read_key_pair(file: Path) -> KeyPair:
    """Read a ``.key`` file.

    Raises:
        PortError: when it cannot be read, holds no key pair, or may be read by others.
    """
    table = _read_toml(file)
    public, secret = table.get("public"), table.get("secret")
    if not (isinstance(public, str) and is_z85_key(public) and isinstance(secret, str) and is_z85_key(secret)):
        raise PortError(f"{file}: found no key pair; expected public and secret, 40 characters each")
    if file.stat().st_mode & 0o077:
        raise PortError(f"{file}: others may read this secret key; run `chmod 600 {file}`, or make a new one")
    if zmq.curve_public(secret.encode("ascii")).decode("ascii") != public:
        raise PortError(f"{file}: its public key does not belong to its secret key; make a new pair")
    return KeyPair(public, secret)


def read_public_key(file: Path) -> str:
    """Read the public key of a ``.pub`` or ``.key`` file.

    Raises:
        PortError: when there is none.
    """
    public = _read_toml(file).get("public")
    if not is_z85_key(public):
        raise PortError(f"{file}: found no public key; expected public = 40 characters")
    return str(public)


def is_z85_key(text: object) -> bool:
    """Whether this is a key in Z85."""
    if not isinstance(text, str) or len(text) != 40:
        return False
    try:
        return len(zmq.utils.z85.decode(text.encode("ascii"))) == 32
    except (KeyError, UnicodeEncodeError, ValueError, OverflowError):
        return False


def read_grants(file: Path) -> tuple[KeyGrant, ...]:
    """Read an allow-list; without such a file no peer is allowed.

    Raises:
        PortError: naming file, entry, value found and what is expected.
    """
    if not file.exists():
        return ()
    try:
        grants = msgspec.convert(_read_toml(file), _AllowListFile).allow
    except msgspec.ValidationError as error:
        raise PortError(f"{file}: {error}") from error
    names: set[str] = set()
    keys: set[str] = set()
    for grant in grants:
        where = f"{file}: {grant.name!r}"
        if _KEY_NAME_PATTERN.fullmatch(grant.name) is None:
            raise PortError(f"{file}: name: found {grant.name!r}; expected {_KEY_NAME_RULE}")
        if not is_z85_key(grant.key):
            raise PortError(f"{where}: key: found {grant.key!r}; expected a public key of 40 characters (Z85)")
        if grant.name in names or grant.key in keys:
            raise PortError(f"{where}: name or key stands there twice; expected one entry a key")
        for port in grant.ports:
            if port not in PORT_NAMES:
                raise PortError(f"{where}: ports: found {port!r}; expected {', '.join(PORT_NAMES)}")
        names.add(grant.name)
        keys.add(grant.key)
    return grants


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise PortError(f"{file}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise PortError(f"{file}: found {error}; expected TOML") from error


_GRANT_HEADER: Final = "[[allow]]"


def add_grant(folder: Path, grant: KeyGrant) -> Path:
    """Add an entry to the allow-list in ``folder``; return the list's file. A running engine sees it in a second.

    Raises:
        PortError: when name or key stand there already, or a value cannot be.
    """
    file = folder / ALLOW_LIST_FILE
    text = file.read_text("utf-8") if file.exists() else ""
    lines = [
        _GRANT_HEADER,
        *(f"{field} = {json.dumps(value, ensure_ascii=False)}" for field, value in _grant_fields(grant).items()),
    ]
    _replace_allow_list(file, text + ("\n" if text.strip() else "") + "\n".join(lines) + "\n")
    return file


def remove_grant(folder: Path, name: str) -> None:
    """Take an entry off the allow-list; a running engine sees it in a second.

    Raises:
        PortError: when there is none of this name.
    """
    file = folder / ALLOW_LIST_FILE
    names = [grant.name for grant in read_grants(file)]
    if name not in names:
        raise PortError(f"{file}: found no key named {name!r}; it has {', '.join(names) or 'none'}")
    blocks: list[str] = [""]
    for line in file.read_text("utf-8").splitlines(keepends=True):
        if line.split("#")[0].strip() == _GRANT_HEADER:
            blocks.append("")
        blocks[-1] += line
    kept = [block for block in blocks if not any(entry["name"] == name for entry in _parse_grants(block))]
    _replace_allow_list(file, "".join(kept))


def _parse_grants(block: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = tomllib.loads(block).get("allow", [])
    return entries


def _grant_fields(grant: KeyGrant) -> dict[str, Any]:
    fields = {field: getattr(grant, field) for field in grant.__struct_fields__}
    return {field: list(value) if isinstance(value, tuple) else value for field, value in fields.items() if value}


def _replace_allow_list(file: Path, text: str) -> None:
    """Replace the file by ``text`` atomically, and only if it is a valid list."""
    new = file.with_suffix(".new")
    new.write_text(text, "utf-8")
    try:
        read_grants(new)
    except PortError as error:
        new.unlink()
        raise PortError(str(error).replace(str(new), str(file))) from error
    new.replace(file)


ZAP_ENDPOINT: Final = "inproc://zeromq.zap.01"


class AllowList:
    """The allow-list as its file is now.

    Attributes:
        error: why the file as it is now cannot be used; while there is one, the last good list counts.
    """

    def __init__(self, folder: Path) -> None:
        """Read the list in ``folder``.

        Raises:
            PortError: when it cannot be used.
        """
        self._file = folder / ALLOW_LIST_FILE
        self._stamp = self._file_stamp()
        self._revoked_ports: set[str] = set()
        self._set(read_grants(self._file))
        self.error = ""

    def refresh(self) -> None:
        """Read the file again if it changed."""
        stamp = self._file_stamp()
        if stamp == self._stamp:
            return
        self._stamp = stamp
        try:
            grants = read_grants(self._file)
        except PortError as error:
            self.error = str(error)
            return
        self.error = ""
        before = self._by_key
        self._set(grants)
        now = {key: grant.ports for key, grant in self._by_key.items()}
        self._revoked_ports |= {
            port for key, grant in before.items() for port in grant.ports if port not in now.get(key, ())
        }

    def pop_revoked_ports(self) -> frozenset[str]:
        """Return the ports that some key may use no longer, since this was last asked."""
        revoked_ports, self._revoked_ports = frozenset(self._revoked_ports), set()
        return revoked_ports

    def grant_for_key(self, key: str) -> KeyGrant | None:
        """Return the entry of this public key."""
        return self._by_key.get(key)

    def __len__(self) -> int:
        """Return the number of keys."""
        return len(self._by_key)

    def _set(self, grants: Sequence[KeyGrant]) -> None:
        self._by_key: Mapping[str, KeyGrant] = {grant.key: grant for grant in grants}

    def _file_stamp(self) -> tuple[int, int, int] | None:
        try:
            stat = self._file.stat()
        except OSError:
            return None
        return stat.st_mtime_ns, stat.st_size, stat.st_ino


class ZapAuthenticator:
    """Answers libzmq's questions about who may connect to which port.

    Attributes:
        refused: handshakes refused, by port; a refused peer cannot send any message.
        admitted: handshakes admitted, by port.
    """

    def __init__(self, socket: zmq.Socket[bytes], allowed: AllowList) -> None:
        """Serve ``socket``, a REP bound to :data:`ZAP_ENDPOINT`."""
        self._socket = socket
        self._allowed = allowed
        self.refused: Counter[str] = Counter()
        self.admitted: Counter[str] = Counter()

    def serve(self, max_items: int = 64) -> None:
        """Answer what was asked, at most ``max_items`` questions."""
        for _ in range(max_items):
            try:
                frames = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._socket.send_multipart(self._reply_safely(frames))

    def _reply_safely(self, frames: Sequence[bytes]) -> list[bytes]:
        """Answer whatever happens: a question without an answer would be the last one that libzmq asks."""
        try:
            return self._reply(frames)
        except Exception as error:  # noqa: BLE001 - see above
            self.refused[f"{type(error).__name__}: {error}"[:200]] += 1
            request = frames[1] if len(frames) > 1 else b""
            return [b"1.0", request, b"500", b"the engine cannot tell", b"", b""]

    def _reply(self, frames: Sequence[bytes]) -> list[bytes]:
        version, request = frames[0], frames[1] if len(frames) > 1 else b""
        port = frames[2].decode(errors="replace") if len(frames) > 2 else ""
        grant = None
        if version == b"1.0" and len(frames) == 7 and frames[5] == b"CURVE" and len(frames[6]) == 32:
            key = zmq.utils.z85.encode(frames[6]).decode("ascii")
            # As the list is at this instant: a client that is refused does not come back by itself.
            self._allowed.refresh()
            grant = self._allowed.grant_for_key(key)
        if grant is None or port not in grant.ports:
            self.refused[port] += 1
            return [b"1.0", request, b"400", b"not on the allow-list for this port", b"", b""]
        self.admitted[port] += 1
        # The key itself is the name that libzmq notes on every message: should the key be withdrawn, or exchanged
        # under the same name, then connections made with it count for nothing at once.
        return [b"1.0", request, b"200", b"OK", grant.key.encode("ascii"), b""]
