"""``tickfix keys``: who may come in over the network."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer
from rich import box
from rich.table import Table

from tickfix.api import ConfigError
from tickfix.cli.console import print_json, stdout
from tickfix.ports.authentication import (
    ALLOW_LIST_FILE,
    ENGINE_KEY_NAME,
    KeyGrant,
    create_key_pair,
    read_grants,
    read_public_key,
)
from tickfix.ports.authentication import add_grant as add
from tickfix.ports.authentication import remove_grant as take_off

app = typer.Typer(help="Make keys, and say what each may do.", no_args_is_help=True, pretty_exceptions_enable=False)

_PORTS: Final = "sensors, positions, control or follow; several."

Folder = Annotated[Path, typer.Option("--folder", metavar="DIR", help="Of keys and allow-list.")]
Devices = Annotated[
    list[str] | None, typer.Option("--device", metavar="GLOB", help="A device it may speak for; several.")
]
Ports = Annotated[list[str] | None, typer.Option("--port", metavar="PORT", help=f"A port it may use: {_PORTS}")]


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="`engine` is the engine's own.")],
    *,
    folder: Folder = Path("keys"),
    device: Devices = None,
    port: Ports = None,
) -> None:
    """Make a key pair; with --port put it on the allow-list as well."""
    if name == ENGINE_KEY_NAME and (device or port):
        raise ConfigError("keys new engine", "--device or --port", "neither: the engine is who allows")
    public = create_key_pair(name, folder)
    console = stdout()
    advice = "stays here" if name == ENGINE_KEY_NAME else "move it to whom it is for, show it to nobody"
    console.print(f"{public.with_suffix('.key')}  secret: {advice}", soft_wrap=True)
    console.print(f"{public}  public", soft_wrap=True)
    if name == ENGINE_KEY_NAME:
        console.print(f'Next: in the engine\'s configuration, [ports] keys = "{folder}"', soft_wrap=True)
        console.print(
            f"      tickfix keys new phone-1 --folder {folder} --device phone-1 --port sensors", soft_wrap=True
        )
    elif port:
        grant = KeyGrant(name=name, key=read_public_key(public), devices=tuple(device or ()), ports=tuple(port))
        console.print(f"{add(folder, grant)}  allows it: {_describe_grant(grant)}", soft_wrap=True)
        console.print(f"It needs {folder / ENGINE_KEY_NAME}.pub beside its own key.", soft_wrap=True)


@app.command()
def allow(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What to call it here.")],
    public: Annotated[Path, typer.Argument(metavar="FILE", help="Its NAME.pub.")],
    *,
    folder: Folder = Path("keys"),
    device: Devices = None,
    port: Ports = None,
) -> None:
    """Put a key made elsewhere on the allow-list."""
    if not port:
        raise ConfigError("keys allow", "no --port", f"at least one: {_PORTS}")
    grant = KeyGrant(name=name, key=read_public_key(public), devices=tuple(device or ()), ports=tuple(port))
    stdout().print(f"{add(folder, grant)} allows {name}: {_describe_grant(grant)}", soft_wrap=True)


@app.command()
def withdraw(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As it stands in the allow-list.")],
    *,
    folder: Folder = Path("keys"),
) -> None:
    """Take a key off the allow-list; a running engine stops listening to it within a second."""
    take_off(folder, name)
    stdout().print(f"{folder / ALLOW_LIST_FILE} allows {name} no longer", soft_wrap=True)


@app.command("list")
def list_keys(
    *,
    folder: Folder = Path("keys"),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """List who is allowed, and what."""
    grants = read_grants(folder / ALLOW_LIST_FILE)
    if as_json:
        print_json({grant.name: {"devices": list(grant.devices), "ports": list(grant.ports)} for grant in grants})
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("name", no_wrap=True)
    for column in ("ports", "devices"):
        table.add_column(column, overflow="fold")
    for grant in grants:
        table.add_row(grant.name, ", ".join(grant.ports) or "none", ", ".join(grant.devices) or "none")
    stdout().print(table)


def _describe_grant(grant: KeyGrant) -> str:
    devices = f"for {', '.join(grant.devices)}" if grant.devices else "for no device"
    return f"{', '.join(grant.ports)}, {devices}"
