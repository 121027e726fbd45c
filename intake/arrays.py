"""NumPy's archives from strangers: what is declared is looked at before anything is unpacked."""

import zipfile
import zlib
from collections import Counter
from math import prod
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

#: What an archive may unpack to: a bank of 100 000 wearers has a third of it.
MOST_BYTES = 2**30
_ENDING = ".npy"
#: How a zip file begins, whole or not.
_MAGIC = b"PK\x03\x04"


class NoArraysError(ValueError):
    """A file is no archive of arrays; the message goes on after its name."""


class DamagedArraysError(NoArraysError):
    """It is one, and damaged, or made to take more room than there is."""


def read_arrays(
    path: Path, *, most_bytes: int = MOST_BYTES
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Read a `.npz` file.

    Args:
        path: of the file.
        most_bytes: that all arrays may take together, unpacked.

    Returns:
        The arrays by name, and the names of those that hold objects, which are left out: to read
        them is to run code.

    Raises:
        FileNotFoundError: there is no such file.
        NoArraysError: it is no archive of arrays, or takes a password.
        DamagedArraysError: it is damaged, or says that it holds more than it does or may.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_members(members, most_bytes)
            found = {}
            for member in members:
                with archive.open(member) as stream:
                    found[_name(member)] = _array(stream, member)
    except FileNotFoundError:
        raise
    # An unknown packing is a RuntimeError of zipfile.
    except (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        if not _begins_as_zip(path):
            raise NoArraysError("is no archive of arrays") from None
        raise DamagedArraysError(f"is damaged: {' '.join(str(error).split())}") from None
    arrays = {name: array for name, array in found.items() if array is not None}
    return arrays, [name for name in found if name not in arrays]


def _check_members(members: list[zipfile.ZipInfo], most_bytes: int) -> None:
    if any(member.flag_bits & 1 for member in members):
        raise NoArraysError("takes a password, as no archive of arrays does")
    if twice := [name for name, n in Counter(map(_name, members)).items() if n > 1]:
        raise DamagedArraysError(f"is damaged: it has {twice[0]} twice")
    size = sum(member.file_size for member in members)
    if size > most_bytes:
        raise DamagedArraysError(f"unpacks to {size} bytes; at most {most_bytes}")


def _array(stream: IO[bytes], member: zipfile.ZipInfo) -> np.ndarray | None:
    """Return the array that a member holds; None if it is of objects.

    NumPy makes room for what a header declares, before it looks whether so much follows.
    """
    try:
        shape, dtype = _header(stream)
    except ValueError:
        raise DamagedArraysError(f"is damaged: {_name(member)} is no array of numbers") from None
    if dtype.hasobject:
        return None
    declared, there = prod(shape) * dtype.itemsize, member.file_size - stream.tell()
    if declared != there or min(shape, default=0) < 0:
        raise DamagedArraysError(
            f"is damaged: {_name(member)} declares {declared} bytes, and has {there}"
        )
    stream.seek(0)
    return np.asarray(npy.read_array(stream, allow_pickle=False))


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    version = npy.read_magic(stream)
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
    if read is None:
        # Of tables whose columns have names beyond Latin-1.
        raise ValueError(f"version {version}")
    shape, _, dtype = read(stream)
    return shape, dtype


def _name(member: zipfile.ZipInfo) -> str:
    return member.filename.removesuffix(_ENDING)


def _begins_as_zip(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False
