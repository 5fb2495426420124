"""A parallel map over processes: the same results in the same order as with one process.

On Linux the processes are forked and inherit what the work needs, so only results are pickled. Elsewhere they are
spawned and get it pickled; work that cannot be pickled stays in this process.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tickfix.api import TickfixError

Item = TypeVar("Item")
Result = TypeVar("Result")

_MAX_PROCESSES = 16


def available_cores() -> int:
    """Return how many processes can run in parallel; 1 within a worker."""
    if _inherited:
        return 1
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    return min(_MAX_PROCESSES, cores)


def start_method() -> str:
    """Return how processes are started: forked on Linux only, since system libraries of macOS do not survive a fork."""
    return "fork" if sys.platform == "linux" and hasattr(os, "fork") else "spawn"


def parallel_map(
    function: Callable[[Item], Result], items: Sequence[Item], *, processes: int | None = None
) -> Iterator[Result]:
    """Give ``function(item)`` for each item, in the order of the items.

    Args:
        function: any callable; it must not depend on what ran before.
        items: what to work on.
        processes: how many run in parallel; by default as many as there are cores, 1 stays in this process.

    Raises:
        TickfixError: the first that ``function`` raised, or when a process died.
    """
    count = min(available_cores() if processes is None else processes, len(items))
    method = start_method()
    if count < 2 or (method == "spawn" and not _can_be_pickled(function, items)):
        yield from map(function, items)
        return
    context = multiprocessing.get_context(method)
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_inherit, initargs=(function, items))
    try:
        for done, packed in pool.map(_run_item, range(len(items))):
            if not done:
                raise TickfixError(packed.decode())
            yield pickle.loads(packed)  # noqa: S301 - made a moment ago by our own child
    except BrokenProcessPool as error:
        raise TickfixError("a worker process died, perhaps for want of memory; run fewer walks at a time") from error
    finally:
        pool.shutdown(cancel_futures=True)


def _can_be_pickled(function: Callable[[Item], Result], items: Sequence[Item]) -> bool:
    """Return whether a spawned process can be given the work; closures and read-only mappings cannot be pickled."""
    try:
        pickle.dumps((function, items))
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


class _Packer(pickle.Pickler):
    """Brings values to the parent as they are: mappings and arrays that are read-only stay so."""

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, MappingProxyType):
            return _read_only_mapping, (dict(value),)
        if type(value) is np.ndarray and not value.flags.writeable and value.dtype.kind in "biuf":
            return _read_only_array, (value.tobytes(), value.dtype.str, value.shape)
        return NotImplemented


def _read_only_mapping(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


def _read_only_array(data: bytes, dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    return np.frombuffer(data, dtype=dtype).reshape(shape)


_inherited: list[Any] = []


def _inherit(function: Callable[[Any], Any], items: Sequence[Any]) -> None:
    """Take over, in a child, what was there when it was forked, or what a spawned one is given."""
    _inherited[:] = [function, items]


def _run_item(i: int) -> tuple[bool, bytes]:
    function, items = _inherited
    try:
        result = function(items[i])
    except TickfixError as error:
        # As text: exceptions that take several arguments do not survive pickling.
        return False, str(error).encode()
    buffer = io.BytesIO()
    _Packer(buffer, pickle.HIGHEST_PROTOCOL).dump(result)
    return True, buffer.getvalue()
