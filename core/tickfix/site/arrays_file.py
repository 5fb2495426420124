"""Named arrays in a file: ``.npz`` without pickles, the same bytes for the same arrays."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tickfix.api import SiteError

_KINDS: Final = frozenset("biufU")


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write ``arrays`` in the order of their names.

    Raises:
        SiteError: naming an array that is not of numbers or strings.
    """
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind not in _KINDS:
            raise SiteError(f"{path.name}: {name} holds {np.asarray(array).dtype}; only numbers and strings are kept")
    with zipfile.ZipFile(path, "w") as file:
        for name in sorted(arrays):
            entry = zipfile.ZipInfo(f"{name}.npy")  # dated 1980, always
            entry.compress_type = zipfile.ZIP_DEFLATED
            with file.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(arrays[name]), allow_pickle=False)


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read what :func:`save_arrays` wrote.

    Raises:
        SiteError: when the file is missing, damaged or pickled.
    """
    try:
        file = np.load(BytesIO(path.read_bytes()), allow_pickle=False)
        if not isinstance(file, np.lib.npyio.NpzFile):
            raise SiteError(f"{path}: found a single array, expected an .npz of named arrays; survey again")
        return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise SiteError(f"{path}: missing; restore it from a copy of the site or survey again") from None
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise SiteError(f"{path}: found no readable .npz without pickles ({error}); survey again") from error
