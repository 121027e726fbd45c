"""HDF5 files: every numeric data set as channels."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.log import Log
from analysis.closeloop.logs.matlab_objects import of_object

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
    objects: list[str] = []
    size = 0
    try:
        with h5py.File(path, "r") as file:
            for name, item in _datasets(file, "", set()):
                if item.dtype.kind not in "fiub" or item.shape is None or item.ndim > 3:
                    continue
                if "MATLAB_object_decode" in item.attrs:
                    # Its numbers say where the object is, in what MATLAB keeps for itself.
                    of = item.attrs.get("MATLAB_class", b"object").decode(errors="replace")
                    objects.append(of_object(name.replace("/", "."), of))
                    continue
                size += item.size
                if size > MAX_NUMBERS:
                    what = f"declares {size} numbers; at most {MAX_NUMBERS}"
                    raise SessionError(what, file=path.name)
                unit = _unit(item)
                arrays.append((f"{name} [{unit}]" if unit else name, item[()]))
    except SessionError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        raise SessionError(f"is a damaged {kind} file: {error}", file=path.name) from None
    log = log_of(kind, arrays)
    log.remarks += objects
    return log


def _unit(item: Any) -> str:
    """Return the unit that a data set's attributes say, empty if none, for the end of its path.

    It is deg_s for deg/s: what is after a slash would be another part of the path.
    """
    unit = item.attrs.get("unit", item.attrs.get("units"))
    # Programs in C write text of a fixed length.
    unit = unit.decode(errors="replace") if isinstance(unit, bytes) else unit
    return unit.strip().replace("/", "_") if isinstance(unit, str) else ""


def _datasets(item: Any, path: str, seen: set[int]) -> Iterator[tuple[str, Any]]:
    """Return every data set below an item with its path, each once.

    MATLAB 7.3 keeps elements of cells and of structures elsewhere (`#refs#`), and at their place
    what refers to them. They are numbered from 1, those of a structure before the field's name.
    """
    import h5py

    if (address := h5py.h5o.get_info(item.id).addr) in seen:
        return
    seen.add(address)
    if isinstance(item, h5py.Group):
        for key in item:
            if key.startswith("#") or not isinstance(item.get(key, getlink=True), h5py.HardLink):
                continue
            yield from _datasets(item[key], f"{path}/{key}" if path else key, seen)
    elif not isinstance(item, h5py.Dataset) or item.attrs.get("MATLAB_class") == b"char":
        return
    elif h5py.check_ref_dtype(item.dtype) is not h5py.Reference:
        yield path, item
    elif item.shape is not None and item.size <= MAX_NUMBERS:
        parent, slash, field = path.rpartition("/")
        of_cell = item.attrs.get("MATLAB_class") == b"cell"
        for number, reference in enumerate(np.ravel(item[()]), start=1):
            element = f"{path}/{number}" if of_cell else f"{parent}{slash}{number}/{field}"
            if reference:
                yield from _datasets(item.file[reference], element, seen)
