"""Keyed random streams, and a probe of the machine's arithmetic: what repeating to the bit rests on.

What a stage draws depends on which stage asks for which tick, and on nothing that ran before. Philox is a counter-based
generator [Salmon et al., SC 2011]: its output is a function of a key and a counter. The key is made of seed and device,
the counter of epoch, tick, stage and event; so a rewind draws the same numbers again, and another device or pipeline
changes nobody's. Pipelines share the streams of their stages, which makes an A/B comparison one of common random
numbers."""

from __future__ import annotations

from functools import lru_cache
from hashlib import blake2b, sha256

import numpy as np
import scipy.linalg


class RandomStreams:
    """The random streams of one device.

    One generator serves all of them; its counter is set, not a new one constructed. A stage must therefore not keep the
    generator it was handed beyond the call.
    """

    def __init__(self, seed: int, device: str) -> None:
        """Derive the key from ``seed`` and ``device``."""
        key = np.frombuffer(blake2b(f"{seed}\0{device}".encode(), digest_size=16).digest(), dtype="<u8")
        self._bits = np.random.Philox(key=key.astype(np.uint64))
        self._generator = np.random.Generator(self._bits)
        self._state = self._bits.state

    def at(self, epoch: int, tick: int, stage: str, event: int = 0) -> np.random.Generator:
        """Return the generator at the beginning of the stream of this stage and tick."""
        state = self._state
        # The lowest word counts blocks within a stream; 2⁶⁴ of them cannot run into the next stream.
        state["state"]["counter"][:] = (0, tick % 2**64, _stream_word(stage, event), epoch)
        state["buffer_pos"] = 4  # nothing buffered
        state["has_uint32"] = 0
        self._bits.state = state
        return self._generator


@lru_cache(maxsize=4096)
def _stream_word(stage: str, event: int) -> int:
    return int.from_bytes(blake2b(f"{stage}\0{event}".encode(), digest_size=8).digest(), "little")


_PROBE_SIZE = 48


def numeric_probe() -> str:
    """Return the SHA-256 of exp, sin, a GEMM and two solves on fixed inputs, as hexadecimal.

    Libraries, their vector instructions and the number of BLAS threads may change last bits; runs with different
    probes are not expected to repeat to the byte. NumPy and SciPy bring a LAPACK each, so both solve.
    """
    # Inputs from integers and one division: equal bits everywhere.
    whole = (np.arange(_PROBE_SIZE * _PROBE_SIZE, dtype=np.int64) * 7919 + 104_729) % 10_007
    x = whole.astype(np.float64) / 5003.0 - 1.0
    a = x.reshape(_PROBE_SIZE, _PROBE_SIZE)
    b = a[::-1, ::-1].copy()
    spd = a @ a.T + np.eye(_PROBE_SIZE)
    results = (
        np.exp(x),
        np.sin(37.0 * x),
        a @ b,
        np.linalg.solve(spd, b),
        scipy.linalg.cho_solve((np.linalg.cholesky(spd), True), b),
    )
    return sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in results)).hexdigest()
