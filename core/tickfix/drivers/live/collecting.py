"""Keeping the garbage collector from stopping the loop."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_FULL_EVERY: Final = 1_000
"""Collections of the middle generation between full ones; by default 10."""


@contextmanager
def rare_full_collections() -> Iterator[None]:
    """Leave out of the garbage collector's sight what is there now, and let it look at all of the rest seldom.

    A full collection looks at every state of every device and stops the loop meanwhile. It is there for cycles that
    live long; a device that is gone leaves none, and short-lived ones are found as ever.
    """
    young, middle, full = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(young, middle, _FULL_EVERY)
    try:
        yield
    finally:
        gc.set_threshold(young, middle, full)
        gc.unfreeze()
