"""Which addresses are taken, and which of them others can reach."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from tickfix.api import ConfigError
from tickfix.api.errors import PortError
from tickfix.ports.sockets import check_ipc_path_free, find_listening_process, parse_address, require_keys_unless_local


@pytest.mark.parametrize(
    ("text", "endpoint", "local"),
    [
        ("tcp://127.0.0.1:5571", "tcp://127.0.0.1:5571", True),
        ("tcp://127.8.9.1:1", "tcp://127.8.9.1:1", True),
        ("tcp://localhost:5571", "tcp://127.0.0.1:5571", True),
        ("tcp://127.0.0.1:0", "tcp://127.0.0.1:*", True),
        ("tcp://127.0.0.1:*", "tcp://127.0.0.1:*", True),
        ("tcp://[::1]:5571", "tcp://[::1]:5571", True),
        ("ipc:///run/tickfix/sensors", "ipc:///run/tickfix/sensors", True),
        ("ipc://@tickfix", "ipc://@tickfix", True),
        ("tcp://0.0.0.0:5571", "tcp://0.0.0.0:5571", False),
        ("tcp://*:5571", "tcp://*:5571", False),
        ("tcp://eth0:5571", "tcp://eth0:5571", False),
        ("tcp://192.168.1.4:5571", "tcp://192.168.1.4:5571", False),
        ("tcp://[::]:5571", "tcp://[::]:5571", False),
        ("tcp://127.0.0.1.example.org:5571", "tcp://127.0.0.1.example.org:5571", False),
    ],
)
def test_an_address_is_local_only_when_no_other_machine_can_reach_it(text: str, endpoint: str, local: bool) -> None:
    address = parse_address("ports.sensors", text)
    assert (address.endpoint, address.local) == (endpoint, local)
    if not local:
        with pytest.raises(ConfigError, match=r"ports\.sensors: .*tickfix keys new engine"):
            require_keys_unless_local("ports.sensors", address)


@pytest.mark.parametrize(
    "text",
    ["", "5571", "tcp://127.0.0.1", "tcp://127.0.0.1:99999", "udp://127.0.0.1:1", "inproc://a", "tcp://:1", "ipc://",
     "ipc://*", "ipc://" + "x" * 108, "tcp://a:1;tcp://b:2", "tcp://127.0.0.1:5571/x", "pgm://eth0;239.0.0.1:1"],
)  # fmt: skip
def test_what_is_no_address_is_named_with_its_setting(text: str) -> None:
    with pytest.raises(ConfigError, match=r"ports\.control: found "):
        parse_address("ports.control", text)


def test_an_ipc_path_is_never_taken_from_who_listens_there_nor_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "sensors"
    address = parse_address("ports.sensors", f"ipc://{path}")
    check_ipc_path_free("ports.sensors", address)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        with pytest.raises(PortError, match="is taken"):
            check_ipc_path_free("ports.sensors", address)
    check_ipc_path_free("ports.sensors", address)  # what a dead process left behind is in nobody's way
    path.unlink()
    path.write_text("precious")
    with pytest.raises(PortError, match="is a file"):
        check_ipc_path_free("ports.sensors", address)
    with pytest.raises(PortError, match="no folder"):
        check_ipc_path_free("ports.sensors", parse_address("ports.sensors", f"ipc://{tmp_path}/none/sensors"))


def test_the_holder_of_a_port_is_named() -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        held = find_listening_process(port)
    if Path("/proc/net/tcp").exists():
        assert "python" in held
        assert held.startswith("process ")
    assert f"sport = :{port}" in find_listening_process(port)
