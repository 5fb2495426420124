"""Where ``fcntl``, ``fork`` and ``/proc`` are missing, all but ``tickfix serve`` works, and that says what it lacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

# Takes away what Windows lacks before anything of tickfix is imported. Libraries have been imported by then: they have
# builds of their own for each system.
WINDOWS = """
import asyncio, concurrent.futures, multiprocessing.context, subprocess, sysconfig, tempfile
import matplotlib.figure, mcap.reader, numpy, rich.progress, scipy.optimize, scipy.spatial, scipy.stats, shapely
import typer.rich_utils, zmq
sysconfig.get_config_vars()
import builtins, os, pathlib, signal, socket, sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "resource", "termios", "pwd", "grp"):
            raise ModuleNotFoundError(name)

for name in ("fcntl", "resource", "termios", "pwd", "grp"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Missing())
for module, names in ((os, ("fork", "pread", "pwrite", "sched_getaffinity", "waitpid", "O_DIRECTORY", "WNOHANG")),
                      (signal, ("SIGBUS", "SIGKILL")), (socket, ("AF_UNIX",))):
    for name in names:
        delattr(module, name)
sys.platform = "a system without fork"
honest = builtins.open
def guarded(file, *rest, **options):
    if str(file).startswith("/proc"):
        raise FileNotFoundError(file)
    return honest(file, *rest, **options)
builtins.open = guarded
"""
EVERY_MODULE = """
import importlib, pkgutil, tickfix
for found in pkgutil.walk_packages(tickfix.__path__, "tickfix."):
    if not found.name.startswith("tickfix.testing"):
        importlib.import_module(found.name)
print("imported")
"""
COMMAND = """
from tickfix.cli.main import main
sys.argv = ["tickfix", *ARGUMENTS]
main()
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own code
        [sys.executable, "-c", WINDOWS + code],
        capture_output=True,
        text=True,
        check=False,
    )


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run(COMMAND.replace("ARGUMENTS", repr(arguments)))


def test_every_module_can_be_imported() -> None:
    done = run(EVERY_MODULE)
    assert (done.stdout, done.stderr) == ("imported\n", "")


def test_serve_names_what_the_system_lacks(tmp_path: Path) -> None:
    done = command("serve", str(tmp_path))
    assert done.returncode == 2
    assert "tickfix serve needs fcntl and os.fork" in done.stderr
    assert "a system without fork" in done.stderr


def test_an_off_line_command_runs() -> None:
    done = command("plugins")
    assert done.returncode == 0, done.stderr
    assert "fusion" in done.stdout or "kalman" in done.stdout


def test_an_old_option_is_refused_with_the_new_one_named(tmp_path: Path) -> None:
    done = command("serve", str(tmp_path), "--feed", "tcp://127.0.0.1:*")
    assert done.returncode == 2
    assert "--follow-bind" in done.stderr
