"""The hooks of tickfix, all of them.

A plugin is a module that the entry-point group ``tickfix.plugins`` names. tickfix imports it once, at start-up, and
calls its hooks; hooks only register, the algorithms themselves are ordinary classes (:mod:`tickfix.api.algorithms`).
No result depends on the order in which plugins are called: they are taken in the order of their distribution and
entry-point names, tickfix's own first.

A module may say which interface it was written for, ``TICKFIX_API = 1``; one that asks for another than
:data:`API_VERSION` is reported and left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import pluggy

API_VERSION: Final = 1
"""Changes when a plugin that worked would no longer do so."""

ENTRY_POINT_GROUP: Final = "tickfix.plugins"

hookspec = pluggy.HookspecMarker("tickfix")
hookimpl = pluggy.HookimplMarker("tickfix")
"""Mark a function of your plugin module as a hook: ``@hookimpl`` above ``def tickfix_register(): …``."""


@hookspec
def tickfix_register() -> Sequence[type[Any]]:  # type: ignore[empty-body]
    """Offer algorithms, readers and sinks.

    Called once, when tickfix starts. Return the classes; each says what it is by ``kind`` (``"pdr"``,
    ``"fingerprint"``, ``"filter"``, ``"map"``, ``"reader"``, ``"sink"``) and ``name``, by which pipelines choose it.
    A name that another plugin already offers for the same kind is reported, and that class left out.

    Since API version 1.
    """
