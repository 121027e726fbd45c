"""NumPy's archives of strangers: nothing is unpacked that is larger than it may be, or lies."""

import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from intake.arrays import DamagedArraysError, NoArraysError, read_arrays
from tests.testbed.spoiling import encrypted


def member(shape: tuple[int, ...], content: bytes = b"", descr: str = "<f8") -> bytes:
    """Return a `.npy` file whose header declares what need not be there."""
    head = BytesIO()
    npy.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": shape})
    return head.getvalue() + content


def archive(path: Path, *members: tuple[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members:
            file.writestr(name, content)
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.npz"


def test_arrays_come_by_name_and_objects_are_named_and_left(path: Path) -> None:
    given = {"a": np.arange(6.0).reshape(2, 3), "b": np.array("words"), "c": np.empty((0, 4))}
    given |= {"d": np.asfortranarray(np.arange(6).reshape(2, 3))}
    np.savez_compressed(path, objects=np.array([{}, None], dtype=object), **given)
    arrays, objects = read_arrays(path)
    assert objects == ["objects"] and list(arrays) == list(given)
    assert all(np.array_equal(arrays[name], given[name]) for name in given)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (member((100_000_000_000,), bytes(64)), "a declares 800000000000 bytes, and has 64"),
        (member((2, 2), bytes(24)), "a declares 32 bytes, and has 24"),
        (member((-1, -3), bytes(24)), "a declares 24 bytes, and has 24"),
        (b"1, 2, 3", "a is no array of numbers"),
        (b"", "a is no array of numbers"),
        (b"\x93NUMPY\x01\x00\x10\x00{'shape': 1}    ", "a is no array of numbers"),
    ],
)
def test_an_array_that_is_not_what_its_header_declares_is_damaged(
    content: bytes, said: str, path: Path
) -> None:
    archive(path, ("a.npy", content))
    with pytest.raises(DamagedArraysError, match=f"is damaged: {said}"):
        read_arrays(path)


def test_what_would_unpack_to_more_than_there_may_be_is_left_packed(path: Path) -> None:
    np.savez_compressed(path, zeros=np.zeros(4000))
    with pytest.raises(DamagedArraysError, match="unpacks to 32128 bytes; at most 20000"):
        read_arrays(path, most_bytes=20_000)


def test_half_a_file_and_a_flipped_bit_are_damage(path: Path) -> None:
    np.savez(path, a=np.arange(500.0))
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    for content in (whole[: len(whole) // 2], bytes(flipped)):
        path.write_bytes(content)
        with pytest.raises(DamagedArraysError, match="is damaged"):
            read_arrays(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_arrays_of_one_name_are_damage(path: Path) -> None:
    archive(path, ("a.npy", member((0,))), ("a", member((0,))))
    with pytest.raises(DamagedArraysError, match="has a twice"):
        read_arrays(path)


def test_what_is_no_archive_is_told_from_a_damaged_one(path: Path) -> None:
    np.savez(path, a=np.zeros(3))
    locked = encrypted(path.read_bytes())
    for content, said in ((b"", "no archive"), (b"words", "no archive"), (locked, "a password")):
        path.write_bytes(content)
        with pytest.raises(NoArraysError, match=said) as raised:
            read_arrays(path)
        assert not isinstance(raised.value, DamagedArraysError)
    with pytest.raises(FileNotFoundError):
        read_arrays(path.with_name("nothere.npz"))
