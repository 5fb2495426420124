"""A process that ends with another one, however that went and whatever this one is doing."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import sys
import threading


def die_with(lifeline: int) -> None:
    """End this process as soon as nobody holds the other end of a pipe any more.

    Args:
        lifeline: the end to read from; nothing is ever written to the other one, and only the other process has it.
    """
    if sys.platform == "linux":
        # The kernel sends the signal: no thread is needed, which would wait for a stage that never lets others run.
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
        if select.select([lifeline], [], [], 0)[0]:
            os.kill(os.getpid(), signal.SIGKILL)
    else:
        threading.Thread(target=_wait, args=(lifeline,), name="tickfix-lifeline", daemon=True).start()


def _wait(lifeline: int) -> None:
    os.read(lifeline, 1)
    os.kill(os.getpid(), signal.SIGKILL)
