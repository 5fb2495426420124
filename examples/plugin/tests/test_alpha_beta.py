"""The conformance kit on the filter."""

from __future__ import annotations

from tickfix_alpha_beta.alpha_beta import AlphaBeta

from tickfix.testing import FilterContract


class TestAlphaBeta(FilterContract):
    """Dozens of checks come with the base."""

    algorithm = AlphaBeta
