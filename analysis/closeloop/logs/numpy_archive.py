"""NumPy's arrays, and archives of them: every array of numbers as channels."""

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.hdf5 import MAX_NUMBERS
from analysis.closeloop.logs.log import A_PICKLE, Log

#: Of all arrays together, unpacked; a file of a few bytes can hold any number of zeros.
MAX_BYTES = 8 * MAX_NUMBERS
MOST_DIMENSIONS = 3


def read(path: Path) -> Log:
    """Read a `.npz` file; what it would have to run code for is left out, and said.

    Raises:
        SessionError: the file is damaged, or too large.
    """
    if not zipfile.is_zipfile(path):
        raise SessionError("is no NumPy archive", file=path.name)
    arrays: list[tuple[str, np.ndarray]] = []
    objects = []
    with np.load(path, allow_pickle=False) as archive:
        size = sum(entry.file_size for entry in archive.zip.infolist())
        if size > MAX_BYTES:
            what = f"holds {size} bytes; at most {MAX_BYTES}"
            raise SessionError(what, file=path.name)
        for name in archive.files:
            try:
                array = archive[name]
            except ValueError:
                objects.append(name)
                continue
            arrays += _of_numbers(name, array)
    log = log_of("NumPy", arrays)
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
