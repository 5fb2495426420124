"""A room without clocks, dice and outside: what is called here is told by name."""

from __future__ import annotations

import os
import random
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

_CLOCKS = ("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time")
_FORBIDDEN: tuple[tuple[Any, str, tuple[str, ...]], ...] = (
    (time, "time", (*_CLOCKS, "sleep")),
    (uuid, "uuid", ("uuid1", "uuid4")),
    (os, "os", ("urandom",)),
    (random, "random", ("random", "uniform", "gauss", "randint", "choice", "shuffle", "seed")),
    (
        np.random,
        "numpy.random",
        ("rand", "randn", "random", "normal", "uniform", "choice", "randint", "standard_normal", "seed", "shuffle"),
    ),
)


class OutsideError(Exception):
    """An algorithm asked the world for something that a pure function may not ask for."""


@contextmanager
def sealed() -> Iterator[None]:
    """Let every call to a clock, or to a source of random numbers other than the one given, raise."""
    with ExitStack() as stack:
        for module, label, names in _FORBIDDEN:
            for name in names:
                stack.enter_context(patch.object(module, name, _refusing(f"{label}.{name}")))
        stack.enter_context(patch.object(np.random, "default_rng", _seeded_only(np.random.default_rng)))
        yield


def forbidden_names(cls: type[Any]) -> list[str]:
    """Return what a class's module imported by name, as ``from time import …``: :func:`sealed` cannot refuse that."""
    module = sys.modules.get(cls.__module__)
    known = {id(getattr(source, name)): f"{label}.{name}" for source, label, names in _FORBIDDEN for name in names}
    values = [] if module is None else list(vars(module).values())
    return sorted({known[id(value)] for value in values if id(value) in known})


def _refusing(name: str) -> Callable[..., Any]:
    def refuse(*_: Any, **__: Any) -> Any:
        raise OutsideError(name)

    return refuse


def _seeded_only(default_rng: Callable[..., Any]) -> Callable[..., Any]:
    def make(seed: Any = None) -> Any:
        if seed is None:
            raise OutsideError("numpy.random.default_rng()")
        return default_rng(seed)

    return make
