"""MATLAB files: every numeric array, of structures too, as channels."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs import hdf5
from analysis.closeloop.logs.arrays import log_of
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
    return log_of("MATLAB", _arrays(content, ""))


def _arrays(content: Any, path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Return every numeric array below `content` with its path; elements are numbered from 1."""
    if isinstance(content, dict):
        fields = {key: value for key, value in content.items() if not key.startswith("__")}
    elif hasattr(content, "_fieldnames"):
        fields = {key: getattr(content, key) for key in content._fieldnames}
        if named := _signal(fields):
            parent, slash, _ = path.rpartition("/")
            yield f"{parent}{slash}{named[0]}", named[1]
            return
    elif isinstance(content, np.ndarray) and content.dtype.kind == "O":
        fields = {str(number): value for number, value in enumerate(content.flat, start=1)}
    else:
        if isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
            yield path, content
        return
    for key, value in fields.items():
        yield from _arrays(value, f"{path}/{key}" if path else key)


def _signal(fields: Mapping[str, Any]) -> tuple[str, np.ndarray] | None:
    """Return name and samples of a structure that is one signal, as dSPACE and Simulink write."""
    known = {key.lower(): value for key, value in fields.items()}
    name = known.get("label") or known.get("name")
    values = known.get("data", known.get("values"))
    arrays = [
        value for value in fields.values() if isinstance(value, np.ndarray) and value.size > 1
    ]
    if not isinstance(name, str) or not name or len(arrays) != 1 or arrays[0] is not values:
        return None
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        return None
    unit = known.get("unit")
    # What is a path in the model is none in the file.
    name = name.replace("/", ".")
    return f"{name} [{unit}]" if isinstance(unit, str) and unit else name, values
