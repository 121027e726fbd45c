"""NumPy's arrays, and archives of them: every array of numbers as channels."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.hdf5 import MAX_NUMBERS
from analysis.closeloop.logs.log import A_PICKLE, Log
from intake.arrays import NoArraysError, read_arrays

#: Of all arrays together, unpacked; a file of a few bytes can hold any number of zeros.
MAX_BYTES = 8 * MAX_NUMBERS
MOST_DIMENSIONS = 3


def read(path: Path) -> Log:
    """Read a `.npz` file; what it would have to run code for is left out, and said.

    Raises:
        SessionError: the file is damaged, or too large.
    """
    try:
        arrays, objects = read_arrays(path, most_bytes=MAX_BYTES)
    except NoArraysError as error:
        raise SessionError(str(error), file=path.name) from None
    usable = [both for name, array in arrays.items() for both in _of_numbers(name, array)]
    log = log_of("NumPy", usable)
    log.remarks += [f"{name} holds no numbers, but objects, and was left out" for name in objects]
    return log


def read_array(path: Path) -> Log:
    """Read a `.npy` file: an array of numbers, or a table with named fields.

    Raises:
        SessionError: the file is damaged, or holds objects, as what was no array is saved.
    """
    with path.open("rb") as file:
        if b"'|O'" in file.read(4096).partition(b"}")[0]:
            raise SessionError(A_PICKLE, file=path.name)
    # What says in a few bytes that it is huge is not made room for.
    return log_of("NumPy", _of_numbers("data", np.load(path, mmap_mode="r", allow_pickle=False)))


def _of_numbers(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Return an array with its name, or its named fields, if they hold numbers."""
    if array.dtype.names is not None:
        for field in array.dtype.names:
            yield from _of_numbers(field if name == "data" else f"{name}/{field}", array[field])
    elif array.dtype.kind in "fiub" and array.ndim <= MOST_DIMENSIONS:
        yield name, array
