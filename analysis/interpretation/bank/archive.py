"""NumPy archives from outside: what is none is one kind of error."""

import zipfile
import zlib
from pathlib import Path

import numpy as np


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an `.npz` file by name.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no archive of arrays, or holds what is no array.
    """
    try:
        # An unknown packing and a password are RuntimeErrors of zipfile.
        file = np.load(path, allow_pickle=False)
        if isinstance(file, np.ndarray):
            raise ValueError("one array, and no archive")
        with file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise
    except (OSError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error):
        raise ValueError(f"{path} is no archive of arrays") from None


def is_finite(array: np.ndarray) -> bool:
    """Return whether an array holds real numbers, all of them finite."""
    return array.dtype.kind in "biuf" and bool(np.isfinite(array).all())
