"""Who holds a TCP port: the hint that makes "address in use" worth reading."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Final

_LISTEN: Final = "0A"


def holder_of(port: int) -> str:
    """Name the process that listens on a TCP port of this machine, as far as this user may see it."""
    inodes = _listening(port)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if any(fd.readlink().name in inodes for fd in (folder / "fd").iterdir()):
                command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
                return f"process {folder.name} ({command:.120}) holds it"
    return f"another process holds it, perhaps another tickfix serve; `ss -ltnp sport = :{port}` tells which"


def _listening(port: int) -> set[str]:
    """Return the sockets that listen on the port as they stand in ``/proc/PID/fd``; empty where there is no /proc."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        with suppress(OSError):
            for line in Path(table).read_text(encoding="ascii").splitlines()[1:]:
                columns = line.split()
                if columns[3] == _LISTEN and int(columns[1].rpartition(":")[2], 16) == port:
                    found.add(f"socket:[{columns[9]}]")
    return found
