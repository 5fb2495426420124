"""What the control port tells an engine to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.ledger import Ledger
from tickfix.kernel import Outcome
from tickfix.ports import Command, Hub
from tickfix.ports.intake import Item
from tickfix.wire.decisions import Primary


def obey(
    command: Item, hub: Hub, replica: Folding, ledger: Ledger, names: Sequence[str], drain: Callable[[], None]
) -> bool:
    """Do what the control port was told; return whether the engine is to stop.

    Args:
        command: what else came in is refused: nobody is there to take it.
        drain: settles all that is known of every device.
    """
    if not isinstance(command, Command):
        hub.answer(command, Outcome.BUSY, "this engine takes nothing in")
        return False
    if command.what == "stop":
        command.reply(*_done("stopping"))
        return True
    if command.what == "drain":
        hub.refuse_all("the engine is being drained")
        drain()
        command.reply(*_done("drained: every track is settled; stopping"))
        return True
    name = command.args.get("pipeline")
    if command.what != "primary":
        command.reply(*_refused(f"what: found {command.what!r}, expected drain, stop or primary"))
    elif name not in names:
        command.reply(*_refused(f"pipeline: found {name!r}, expected one of {', '.join(names)}"))
    else:
        decision = Primary(pipeline=str(name))
        ledger.decision(decision, "", 0)
        replica.apply([decision])
        command.reply(*_done(f"{name} is published from now on"))
    return False


def _done(what: str) -> tuple[bool, str]:
    return True, what


def _refused(why: str) -> tuple[bool, str]:
    return False, why
