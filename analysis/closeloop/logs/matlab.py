"""MATLAB files: every numeric array, of structures too, as channels."""

import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs import hdf5
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.log import Log
from analysis.closeloop.logs.matlab_objects import of_object

#: What SciPy calls the format of version 7.3.
_HDF5 = 2
#: Cells that hold at most so many numbers each, all alike, hold a sample each: so few are no trial.
SAMPLE = 32


def read(path: Path) -> Log:
    """Read a MATLAB file of version 4 to 7.2 by SciPy, one of version 7.3 (HDF5) by h5py.

    Raises:
        SessionError: the file is damaged.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, MatReadWarning, matfile_version

    try:
        if matfile_version(path)[0] == _HDF5:
            return hdf5.read(path, kind="MATLAB")
        with warnings.catch_warnings():
            # Objects have no name for SciPy: several are one name twice.
            warnings.simplefilter("ignore", MatReadWarning)
            content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (MatReadError, ValueError, TypeError, OverflowError, IndexError, KeyError) as error:
        raise SessionError(f"is no MATLAB file: {error}", file=path.name) from None
    log = log_of("MATLAB", _arrays(content, ""))
    log.remarks += _of_objects(content)
    return log


def _of_objects(content: Mapping[str, Any]) -> list[str]:
    """Say which objects only MATLAB can read, and how to save what they hold."""
    from scipy.io.matlab import MatlabOpaque

    kinds: Any = MatlabOpaque
    found = []
    for opaque in content.values():
        if isinstance(opaque, kinds) and opaque.size:
            entry = opaque.flat[0]
            name, kind = (bytes(entry[at]).decode("latin-1") for at in ("s0", "s2"))
            found.append(of_object(name, kind))
    return found


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
        if (samples := _samples(content)) is not None:
            yield path, samples
            return
        fields = {str(number): value for number, value in enumerate(content.flat, start=1)}
    else:
        if isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
            yield path, content
        return
    for key, value in fields.items():
        yield from _arrays(value, f"{path}/{key}" if path else key)


def _samples(cells: np.ndarray) -> np.ndarray | None:
    """Return cells of which each holds one sample as a table, (n, joints); None if they do not."""
    vectors = [cell for cell in cells.flat if isinstance(cell, np.ndarray) and cell.ndim == 1]
    if len(vectors) < cells.size or not all(one.dtype.kind in "fiub" for one in vectors):
        return None
    sizes = {len(one) for one in vectors}
    if len(sizes) != 1 or not 0 < min(sizes) <= min(SAMPLE, cells.size - 1):
        return None
    return np.stack(vectors)


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
