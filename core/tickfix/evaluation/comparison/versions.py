"""Which code computed a result: versions to read, and a digest that changes with every line."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np
import scipy

import tickfix
from tickfix.config import PipelineConfig

_APART: Final = (
    "cli/",
    "client/",
    "evaluation/comparison/points.py",
    "evaluation/comparison/pooled.py",
    "evaluation/comparison/result.py",
    "evaluation/report/",
    "evaluation/statistics/",
    "journal/",
    "ports/",
    "reproduction/",
    "simulation/",
    "testing/",
    "wire/",
)


def versions(pipelines: Iterable[PipelineConfig]) -> Mapping[str, str]:
    """Return the versions of Python, numpy, scipy, tickfix, and of the packages that the algorithms came from."""
    offers = [choice.offer for pipeline in pipelines for choice in pipeline.choices]
    return {
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "tickfix": tickfix.__version__,
        **{offer.distribution: offer.version for offer in sorted(offers, key=lambda offer: offer.distribution)},
    }


def code_digest(pipeline: PipelineConfig) -> str:
    """Return the SHA-256 of the source of tickfix and of the packages that the pipeline's algorithms live in.

    Versions of packages under work stay the same while their code does not; results must not outlive their code. Of
    tickfix only those rooms count that a walk goes through.
    """
    modules = {choice.offer.cls.__module__ for choice in pipeline.choices} | {"tickfix"}
    return sha256("".join(_source_digest(module) for module in sorted(modules)).encode()).hexdigest()


@cache
def _source_digest(module: str) -> str:
    root = sys.modules[module.partition(".")[0]]
    place = getattr(root, "__file__", None) or getattr(sys.modules[module], "__file__", None)
    if place is None:
        return ""
    file = Path(place)
    files = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    sha = sha256()
    for one in files:
        name = one.relative_to(file.parent).as_posix()
        if module != "tickfix" or not name.startswith(_APART):
            sha.update(name.encode() + b"\0" + one.read_bytes())
    return sha.hexdigest()
