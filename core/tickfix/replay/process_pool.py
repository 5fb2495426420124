"""A parallel map over forked processes.

The same results in the same order as with one process. Only results are pickled; what the work needs is inherited by
the fork.
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
    """Return how many processes can work at once; 1 where forking is not safe, and within a worker."""
    if _inherited:
        return 1
    return min(_MAX_PROCESSES, len(os.sched_getaffinity(0))) if sys.platform == "linux" else 1


def parallel_map(
    function: Callable[[Item], Result], items: Sequence[Item], *, processes: int | None = None
) -> Iterator[Result]:
    """Give ``function(item)`` for each item, in the order of the items.

    Args:
        function: any callable; it must not depend on what ran before.
        items: what to work on.
        processes: how many work at once; by default as many as there are cores, 1 stays in this process.

    Raises:
        TickfixError: the first that ``function`` raised, or when a process died.
    """
    count = min(available_cores() if processes is None else processes, len(items))
    if count < 2:
        yield from map(function, items)
        return
    context = multiprocessing.get_context("fork")
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
    """Take over, in a child, what was there when it was forked."""
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
