"""NumPy's archives: every array of numbers as channels."""

import zipfile
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.hdf5 import MAX_NUMBERS
from analysis.closeloop.logs.log import Log

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
    arrays, objects = [], []
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
            if array.dtype.kind in "fiub" and array.ndim <= MOST_DIMENSIONS:
                arrays.append((name, array))
    log = log_of("NumPy", arrays)
    log.remarks += [f"{name} holds no numbers, but objects, and was left out" for name in objects]
    return log
