"""``tickfix control``: tell a running engine to drain, to stop, or which pipeline to publish."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tickfix.api import ConfigError
from tickfix.cli.output import stdout
from tickfix.cli.status import own_keys
from tickfix.client import Control


class What(StrEnum):
    """What an engine can be told."""

    STOP = "stop"
    DRAIN = "drain"
    PRIMARY = "primary"


def control(
    what: Annotated[What, typer.Argument(help="stop: now, to be resumed; drain: settle every track first.")],
    pipeline: Annotated[str, typer.Argument(metavar="[PIPELINE]", help="The one to publish, for primary.")] = "",
    *,
    at: Annotated[
        str, typer.Option("--at", metavar="ADDRESS", help="The engine's control port.")
    ] = "tcp://127.0.0.1:5573",
    key: Annotated[
        Path | None,
        typer.Option("--key", metavar="FILE", help="Own NAME.key, made by `tickfix keys`; engine.pub lies beside it."),
    ] = None,
) -> None:
    """Tell a running engine what to do; what it decides is in its journal."""
    if (what is What.PRIMARY) != bool(pipeline):
        raise ConfigError("control", f"{what} {pipeline}".strip(), "stop, drain, or primary PIPELINE")
    with Control(at, keys=own_keys(key), timeout_s=30.0) as engine:
        args = {"pipeline": pipeline} if pipeline else {}
        stdout().print(engine.request(what.value, **args), soft_wrap=True)
