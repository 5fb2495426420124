"""Workers as processes: how their ends are told, and that none outlives the one it works for."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys

# In processes of their own: forking belongs into a program with one thread, which a test runner is not.
ENDS = """
import json, os, signal, sys
from tickfix.live.worker import WorkerHandle
from tickfix.live.protocol import WorkerError

def echo(line, notices):
    while True:
        line.send_bytes(line.recv_bytes()[::-1])

def ending(how):
    def work(line, notices):
        line.recv_bytes()
        how()
    return work

def fail():
    raise RuntimeError("on purpose")

ends = {"abort": os.abort, "fail": fail, "kill": lambda: os.kill(os.getpid(), signal.SIGKILL)}
members = [WorkerHandle(0, echo)]
for work in ends.values():
    members.append(WorkerHandle(len(members), ending(work), tuple(members)))
told = {}
for name, member in zip(ends, members[1:]):
    member.submit(b"go")
    try:
        member.response()
    except WorkerError as error:
        told[name] = [str(error).replace(str(member._pid), "N"), error.signal]
members[0].submit(b"abc")
assert members[0].response() == b"cba"
members[0].join()
print(json.dumps(told))
"""

LEFT = """
import os, sys
from itertools import repeat
from tickfix.live.worker import WorkerHandle

def hang(line, notices):
    notices.send_bytes(str(os.getpid()).encode())
    sum(repeat(0))  # lets no other thread of its process run

member = WorkerHandle(0, hang)
print(member.completions.recv_bytes().decode(), flush=True)
sys.stdin.read()
"""


def test_how_a_worker_ended_is_told_and_the_others_go_on() -> None:
    command = [sys.executable, "-W", "error", "-c", ENDS]
    done = subprocess.run(command, capture_output=True, check=False, encoding="utf-8", timeout=300)  # noqa: S603
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {
        "abort": ["worker 2 (process N) was ended by signal 6", 6],
        "fail": ["worker 3 (process N) ended with code 70, see above", 0],
        "kill": ["worker 4 (process N) was ended by signal 9", 9],
    }
    assert "RuntimeError: on purpose" in done.stderr


def test_a_worker_that_hangs_does_not_outlive_the_process_it_works_for() -> None:
    command = [sys.executable, "-W", "error", "-c", LEFT]
    engine = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8")  # noqa: S603
    assert engine.stdout is not None
    worker = os.pidfd_open(int(engine.stdout.readline()))
    engine.kill()
    engine.communicate(timeout=300)
    try:
        # Readable once the worker has ended.
        assert select.select([worker], [], [], 60.0)[0]
    finally:
        os.close(worker)
