"""HDF5 files: every numeric data set as channels."""

from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import channels
from analysis.closeloop.logs.log import Log

#: Of all signals together; a file of a few bytes can declare any number.
MAX_NUMBERS = 50_000_000


def read(path: Path, *, kind: str = "HDF5") -> Log:
    """Read an HDF5 file; links that lead out of it are not followed.

    Raises:
        SessionError: the file is damaged.
        ModuleNotFoundError: h5py is missing.
    """
    import h5py

    if not h5py.is_hdf5(path):
        raise SessionError(f"is no {kind} file", file=path.name)
    arrays: list[tuple[str, np.ndarray]] = []

    def take(name: str, item: Any) -> None:
        # MATLAB keeps what cells refer to below this name.
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        if item.dtype.kind not in "fiub" or item.shape is None or item.ndim > 3:
            return
        if (size := item.size + sum(array.size for _, array in arrays)) > MAX_NUMBERS:
            raise SessionError(f"declares {size} numbers; at most {MAX_NUMBERS}", file=path.name)
        arrays.append((name.replace("/", "."), item[()]))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(take)
    except SessionError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        raise SessionError(f"is a damaged {kind} file: {error}", file=path.name) from None
    return Log(kind=kind, channels=channels(arrays))
