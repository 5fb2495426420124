"""The client stands on pyzmq and msgpack alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import zmq

from tickfix import client, wire
from tickfix.client import ClientError, Keys

ALONE = """
import sys
from importlib.abc import MetaPathFinder

ALLOWED = {"zmq", "msgpack", "tickfix", "cython_runtime", "_cython_3_0_12"} | set(sys.stdlib_module_names)

class OnlyThese(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        inside = top == "tickfix" and name != "tickfix" and not name.startswith("tickfix.client")
        if inside or top not in ALLOWED:
            raise ModuleNotFoundError(f"blocked: {name}", name=name)

sys.meta_path.insert(0, OnlyThese())
from tickfix.client import Control, Listener, Sensor

sensor = Sensor("tcp://127.0.0.1:9", "d")
sensor.motion({"gyroscope": ([1], [[1.0, 2.0, 3.0]])})
assert sensor.close() == 1
Listener("tcp://127.0.0.1:9").close()
Control("tcp://127.0.0.1:9").close()
print(sorted({"numpy", "msgspec", "tickfix.api"} & set(sys.modules)))
"""


def test_it_runs_where_nothing_but_pyzmq_and_msgpack_is():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=False)  # noqa: S603  # our own words
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[]\n"


def test_it_speaks_the_version_of_the_wire():
    assert client.VERSION == wire.VERSION


def pair(folder, name):
    public, secret = (half.decode() for half in zmq.curve_keypair())
    (folder / f"{name}.key").write_text(f'public = "{public}"\nsecret = "{secret}"\n')
    (folder / f"{name}.pub").write_text(f'public = "{public}"\n')
    return public, secret


def test_keys_are_read_from_their_files(tmp_path):
    public, secret = pair(tmp_path, "phone")
    engine, _ = pair(tmp_path, "engine")
    keys = Keys.read(tmp_path / "phone.key", tmp_path / "engine.pub")
    assert (keys.public, keys.secret, keys.engine) == (public, secret, engine)
    assert secret not in repr(keys)


def test_files_without_keys_are_named(tmp_path):
    pair(tmp_path, "phone")
    with pytest.raises(ClientError, match=r"engine\.pub: cannot be read"):
        Keys.read(tmp_path / "phone.key", tmp_path / "engine.pub")
    with pytest.raises(ClientError, match=r"phone\.pub: found no secret key"):
        Keys.read(tmp_path / "phone.pub", tmp_path / "phone.pub")
    Path(tmp_path / "broken.key").write_text("secret = ")
    with pytest.raises(ClientError, match=r"broken\.key: cannot be read"):
        Keys.read(tmp_path / "broken.key", tmp_path / "phone.pub")


def test_a_sensor_with_keys_talks_to_an_engine_with_keys(sockets, until, tmp_path):
    pair(tmp_path, "phone")
    _, secret = pair(tmp_path, "engine")
    router = sockets.context.socket(zmq.ROUTER)
    router.curve_server = True
    router.curve_secretkey = secret.encode()
    router.bind("tcp://127.0.0.1:*")
    address = router.getsockopt_string(zmq.LAST_ENDPOINT)
    keys = Keys.read(tmp_path / "phone.key", tmp_path / "engine.pub")
    sensor = sockets.keep(client.Sensor(address, "d", keys=keys, context=sockets.context))
    until(lambda: router.poll(5), lambda: sensor.flush(0.0))
    router.close(linger=0)
