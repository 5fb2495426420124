"""Operation counts of one localisation, by the formulas of [sun2013] Table 3: not what a matrix library executes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Operations:
    """Numbers of operations."""

    additions: int
    multiplications: int
    square_roots: int


def operation_counts(L: int, M: int, N: int, K: int) -> dict[str, Operations]:
    """Return the operations of each algorithm of [sun2013] Table 3, by its name there.

    Args:
        L: reference points.
        M: access points.
        N: on-line samples.
        K: points selected.
    """
    return {
        "KNN": Operations(L * (2 * M - 1) + 2 * K - 2, L * M + 2, L),
        "WKNN": Operations(L * (2 * M - 1) + 4 * K - 4, L * M + 2 * K + 2, L),
        "NCC (1)": Operations(L * (7 * M * N - 5) + 2 * K - 2, L * (3 * M * N + 4) + 2, 2 * L),
        "FNCC (5)": Operations(L * (6 * M * N - 4) + 2 * K - 2, L * (2 * M * N + 4) + 2, 0),
        "FNCC (6)": Operations(L * (4 * M * N - 2) + 2 * K - 2, L * (2 * M * N + 6) + 2, 0),
    }
