"""MATLAB files: every numeric array, of structures too, as channels."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs import hdf5
from analysis.closeloop.logs.arrays import channels
from analysis.closeloop.logs.log import Log

#: What SciPy calls the format of version 7.3.
_HDF5 = 2


def read(path: Path) -> Log:
    """Read a MATLAB file of version 4 to 7.2 by SciPy, one of version 7.3 (HDF5) by h5py.

    Raises:
        SessionError: the file is damaged.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, matfile_version

    try:
        if matfile_version(path)[0] == _HDF5:
            return hdf5.read(path, kind="MATLAB")
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (MatReadError, ValueError, TypeError, OverflowError, IndexError, KeyError) as error:
        raise SessionError(f"is no MATLAB file: {error}", file=path.name) from None
    return Log(kind="MATLAB", channels=channels(_arrays(content, "")))


def _arrays(content: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Return every numeric array below `content` with its path of names."""
    if isinstance(content, dict):
        fields = {key: value for key, value in content.items() if not key.startswith("__")}
    elif hasattr(content, "_fieldnames"):
        fields = {key: getattr(content, key) for key in content._fieldnames}
    else:
        if isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
            yield name, content
        return
    for key, value in fields.items():
        yield from _arrays(value, f"{name}.{key}" if name else key)
