"""Key files, the allow-list, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tickfix.api import ConfigError
from tickfix.api.errors import PortError
from tickfix.ports.authentication import (
    AllowList,
    create_key_pair,
    is_z85_key,
    read_grants,
    read_key_pair,
    read_public_key,
)
from tickfix.ports.port_settings import PeerLimits


def entry(name: str, key: str, **more: str) -> str:
    lines = [f'name = "{name}"', f'key = "{key}"', *(f"{k} = {v}" for k, v in more.items())]
    return "[[allow]]\n" + "\n".join(lines) + "\n"


def test_a_pair_is_made_for_its_owner_only_and_read_again(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    public = create_key_pair("engine", folder)
    pair = read_key_pair(folder / "engine.key")
    assert is_z85_key(pair.public)
    assert is_z85_key(pair.secret)
    assert read_public_key(public) == read_public_key(folder / "engine.key") == pair.public
    assert pair.secret not in public.read_text()
    assert (folder / "engine.key").stat().st_mode & 0o777 == 0o600
    assert folder.stat().st_mode & 0o077 == 0
    with pytest.raises(PortError, match="exists already and is left alone"):
        create_key_pair("engine", folder)
    assert read_key_pair(folder / "engine.key") == pair


@pytest.mark.parametrize("name", ["", "../engine", "a/b", "a b", ".hidden", "ä", "x" * 65, "-rf"])
def test_a_name_that_could_be_a_path_makes_no_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="name: found"):
        create_key_pair(name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_secret_that_others_may_read_is_refused(tmp_path: Path) -> None:
    create_key_pair("engine", tmp_path)
    (tmp_path / "engine.key").chmod(0o640)
    with pytest.raises(PortError, match="chmod 600"):
        read_key_pair(tmp_path / "engine.key")


def test_halves_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    create_key_pair("a", tmp_path)
    create_key_pair("b", tmp_path)
    a, b = read_key_pair(tmp_path / "a.key"), read_key_pair(tmp_path / "b.key")
    (tmp_path / "a.key").write_text(f'public = "{b.public}"\nsecret = "{a.secret}"\n')
    with pytest.raises(PortError, match="does not belong"):
        read_key_pair(tmp_path / "a.key")


def test_a_grant_says_what_its_key_may_do(tmp_path: Path) -> None:
    key = read_public_key(create_key_pair("gateway", tmp_path))
    text = entry("gateway", key, devices='["floor1-*", "cart"]', ports='["sensors", "control"]', most_devices="500")
    (tmp_path / "allowed.toml").write_text(text)
    (grant,) = read_grants(tmp_path / "allowed.toml")
    assert [grant.allows_device(d) for d in ("floor1-a", "cart", "cart2", "Floor1-a", "floor1")] == [1, 1, 0, 0, 0]
    defaults = PeerLimits()
    assert grant.limits(defaults).devices == 500
    assert grant.limits(defaults).messages_per_s == defaults.messages_per_s


def test_an_entry_without_devices_or_ports_may_do_nothing(tmp_path: Path) -> None:
    (tmp_path / "allowed.toml").write_text(entry("a", read_public_key(create_key_pair("a", tmp_path))))
    (grant,) = read_grants(tmp_path / "allowed.toml")
    assert not grant.allows_device("a")
    assert grant.ports == ()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (entry("a", "short"), "'a': key: found 'short'"),
        (entry("a", '"' * 2), "allowed.toml"),
        (entry("a", "KEY", ports='["sensor"]'), "ports: found 'sensor'"),
        (entry("a", "KEY") + entry("a", "OTHER"), "stands there twice"),
        (entry("a", "KEY") + entry("b", "KEY"), "stands there twice"),
        (entry("", "KEY"), "name: found ''"),
        (entry("../a", "KEY"), "name: found '../a'"),
        (entry("a", "KEY", device='["x"]'), "device"),
        (entry("a", "KEY", messages_per_s="0"), "messages_per_s"),
        ("[[allow]", "expected TOML"),
        ("allow = 3", "allow"),
    ],
)
def test_a_broken_list_is_refused_by_entry_and_field(tmp_path: Path, text: str, named: str) -> None:
    keys = {name: read_public_key(create_key_pair(name, tmp_path)) for name in ("one", "other")}
    file = tmp_path / "allowed.toml"
    file.write_text(text.replace("KEY", keys["one"]).replace("OTHER", keys["other"]))
    with pytest.raises(PortError) as caught:
        read_grants(file)
    assert named in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_list_is_read_again_when_it_changes_and_a_broken_one_changes_nothing(tmp_path: Path) -> None:
    keys = {name: read_public_key(create_key_pair(name, tmp_path)) for name in ("a", "b")}
    file = tmp_path / "allowed.toml"
    allowed = AllowList(tmp_path)
    assert len(allowed) == 0

    def write(text: str) -> None:
        # As an editor does it: a new file takes the old one's place.
        (tmp_path / "new").write_text(text)
        (tmp_path / "new").replace(file)

    write(entry("a", keys["a"], ports='["sensors", "positions"]') + entry("b", keys["b"], ports='["control"]'))
    allowed.refresh()
    assert allowed.grant_for_key(keys["a"]) is not None
    write("[[allow]")
    allowed.refresh()
    assert "expected TOML" in allowed.error
    assert allowed.grant_for_key(keys["a"]) is not None
    write(entry("a", keys["a"], ports='["sensors"]'))
    assert allowed.pop_revoked_ports() == frozenset()
    allowed.refresh()
    assert allowed.pop_revoked_ports() == {"positions", "control"}
    assert allowed.pop_revoked_ports() == frozenset()
    assert allowed.error == ""
    assert allowed.grant_for_key(keys["b"]) is None
    file.unlink()
    allowed.refresh()
    assert allowed.pop_revoked_ports() == {"sensors"}
    assert len(allowed) == 0
