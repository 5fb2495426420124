"""Which papers can be reproduced: by name, each imported when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final

from tickfix.reproduction.experiment import Experiment

PAPERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "jiang2015": "tickfix.reproduction.jiang2015.experiment",
        "sun2013": "tickfix.reproduction.sun2013.experiment",
        "wang2015": "tickfix.reproduction.wang2015.experiment",
    }
)
"""The module of each paper that offers its ``EXPERIMENT``, in the order in which ``all`` runs them."""


def experiment(paper: str) -> Experiment[Any]:
    """Return the experiment of a paper.

    Raises:
        ValueError: naming the papers there are.
    """
    if paper not in PAPERS:
        raise ValueError(f"paper: found {paper!r}, expected one of {', '.join(PAPERS)}")
    found: Experiment[Any] = import_module(PAPERS[paper]).EXPERIMENT
    return found
