"""tickfix follows people indoors: motion sensors and Wi-Fi scans in, a position every 200 ms out.

Plugin authors import :mod:`tickfix.api`; everything else is the framework itself.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("tickfix")
except PackageNotFoundError:  # run from a checkout that nobody installed
    __version__ = "0+unknown"

__all__ = ["__version__"]
