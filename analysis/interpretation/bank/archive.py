"""Arrays of numbers from outside."""

from pathlib import Path

import numpy as np

from intake import arrays
from intake.arrays import NoArraysError


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an `.npz` file by name.

    Raises:
        FileNotFoundError: there is no such file.
        NoArraysError: it is no archive of arrays, is damaged, or holds what are no numbers.
    """
    found, objects = arrays.read_arrays(path)
    if objects:
        raise NoArraysError(f"holds {objects[0]}, which are objects and no numbers")
    return found


def is_finite(array: np.ndarray) -> bool:
    """Return whether an array holds real numbers, all of them finite."""
    return array.dtype.kind in "biuf" and bool(np.isfinite(array).all())
