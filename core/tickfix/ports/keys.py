"""Keys and the allow-list: files in one folder.

``NAME.key`` is a key pair, for its owner's eyes only; ``NAME.pub`` is its public half, to be given away. The engine's
own pair is called ``engine``. ``allowed.toml`` says who may come in::

    [[allow]]
    name    = "phone-17"
    key     = "…its public key, 40 characters…"
    devices = ["phone-17"]          # globs; what it may speak for
    ports   = ["sensors"]           # sensors, positions, control, follow
"""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import zmq
import zmq.utils.z85

from tickfix.api.errors import ConfigError, PortError
from tickfix.ports.settings import PeerLimits

ENGINE: Final = "engine"
ALLOWED: Final = "allowed.toml"
PORTS: Final = ("sensors", "positions", "control", "follow")
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_NAME_WORDS: Final = "letters, digits, _ and -, at most 64 of them, a letter or digit first"

_Positive = Annotated[float, msgspec.Meta(gt=0)]


class Grant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
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
    messages_per_s: _Positive | None = None
    bytes_per_s: _Positive | None = None
    most_devices: Annotated[int, msgspec.Meta(gt=0)] | None = None

    def speaks_for(self, device: str) -> bool:
        """Whether the key may speak for this device."""
        return any(fnmatchcase(device, glob) for glob in self.devices)

    def limits(self, usual: PeerLimits) -> PeerLimits:
        """Return the limits for this key: the usual ones but for what its entry says."""
        messages_per_s = self.messages_per_s or usual.messages_per_s
        bytes_per_s = self.bytes_per_s or usual.bytes_per_s
        return replace(
            usual,
            messages_per_s=messages_per_s,
            message_burst=max(usual.message_burst, int(messages_per_s)),
            bytes_per_s=bytes_per_s,
            byte_burst=max(usual.byte_burst, int(bytes_per_s)),
            devices=self.most_devices or usual.devices,
        )


class _AllowFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    allow: tuple[Grant, ...] = ()


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A CURVE key pair, both halves as 40 characters of Z85."""

    public: str
    secret: str


def new_pair(name: str, folder: Path) -> Path:
    """Make a key pair in ``folder``; return the file of its public half.

    Raises:
        ConfigError: for a name that is no plain word.
        PortError: when there are such files already; they are left alone.
    """
    if _NAME.fullmatch(name) is None:
        raise ConfigError("name", repr(name), _NAME_WORDS)
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


def read_pair(file: Path) -> KeyPair:
    """Read a ``.key`` file.

    Raises:
        PortError: when it cannot be read, holds no key pair, or may be read by others.
    """
    table = _toml(file)
    public, secret = table.get("public"), table.get("secret")
    if not (isinstance(public, str) and is_key(public) and isinstance(secret, str) and is_key(secret)):
        raise PortError(f"{file}: found no key pair; expected public and secret, 40 characters each")
    if file.stat().st_mode & 0o077:
        raise PortError(f"{file}: others may read this secret key; run `chmod 600 {file}`, or make a new one")
    if zmq.curve_public(secret.encode("ascii")).decode("ascii") != public:
        raise PortError(f"{file}: its public key does not belong to its secret key; make a new pair")
    return KeyPair(public, secret)


def read_public(file: Path) -> str:
    """Read the public key of a ``.pub`` or ``.key`` file.

    Raises:
        PortError: when there is none.
    """
    public = _toml(file).get("public")
    if not is_key(public):
        raise PortError(f"{file}: found no public key; expected public = 40 characters")
    return str(public)


def is_key(text: object) -> bool:
    """Whether this is a key in Z85."""
    if not isinstance(text, str) or len(text) != 40:
        return False
    try:
        return len(zmq.utils.z85.decode(text.encode("ascii"))) == 32
    except (KeyError, UnicodeEncodeError, ValueError, OverflowError):
        return False


def read_grants(file: Path) -> tuple[Grant, ...]:
    """Read an allow-list; where there is no such file nobody is allowed.

    Raises:
        PortError: naming file, entry, value found and what is expected.
    """
    if not file.exists():
        return ()
    try:
        grants = msgspec.convert(_toml(file), _AllowFile).allow
    except msgspec.ValidationError as error:
        raise PortError(f"{file}: {error}") from error
    names: set[str] = set()
    keys: set[str] = set()
    for grant in grants:
        where = f"{file}: {grant.name!r}"
        if _NAME.fullmatch(grant.name) is None:
            raise PortError(f"{file}: name: found {grant.name!r}; expected {_NAME_WORDS}")
        if not is_key(grant.key):
            raise PortError(f"{where}: key: found {grant.key!r}; expected a public key of 40 characters (Z85)")
        if grant.name in names or grant.key in keys:
            raise PortError(f"{where}: name or key stands there twice; expected one entry a key")
        for port in grant.ports:
            if port not in PORTS:
                raise PortError(f"{where}: ports: found {port!r}; expected {', '.join(PORTS)}")
        names.add(grant.name)
        keys.add(grant.key)
    return grants


def _toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise PortError(f"{file}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise PortError(f"{file}: found {error}; expected TOML") from error
