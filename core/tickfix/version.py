"""The version of the installed distribution; apart from the package's face, so that the core need not import that."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Final


def _installed_version() -> str:
    try:
        return version("tickfix")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "0+unknown"


__version__: Final = _installed_version()
