"""What the machine's arithmetic says: bits are promised only where it says the same."""

from __future__ import annotations

from hashlib import sha256

import numpy as np
import scipy.linalg

_SIZE = 48


def numeric_probe() -> str:
    """Return the SHA-256 of exp, sin, a GEMM and two solves on fixed inputs, as hexadecimal.

    Libraries, their vector instructions and the number of BLAS threads may change last bits; runs with different
    probes are not expected to repeat to the byte. NumPy and SciPy bring a LAPACK each, so both solve.
    """
    # Inputs from integers and one division: equal bits everywhere.
    whole = (np.arange(_SIZE * _SIZE, dtype=np.int64) * 7919 + 104_729) % 10_007
    x = whole.astype(np.float64) / 5003.0 - 1.0
    a = x.reshape(_SIZE, _SIZE)
    b = a[::-1, ::-1].copy()
    spd = a @ a.T + np.eye(_SIZE)
    said = (
        np.exp(x),
        np.sin(37.0 * x),
        a @ b,
        np.linalg.solve(spd, b),
        scipy.linalg.cho_solve((np.linalg.cholesky(spd), True), b),
    )
    return sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in said)).hexdigest()
