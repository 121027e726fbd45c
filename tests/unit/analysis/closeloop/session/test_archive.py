"""A zipped session is unpacked where nothing else is, or refused before it does harm."""

import io
import stat
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session import archive as archives
from analysis.closeloop.session.archive import unpacked
from intake import zips
from tests.testbed.spoiling import encrypted


@pytest.fixture(autouse=True)
def scratch(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unpack where nobody else does."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("scratch")))


def zipped(path: Path, files: dict[str, bytes], **options: int) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content, **options)
    return path


@pytest.mark.parametrize("top", ["", "monday/"])
def test_the_session_is_there_while_it_is_needed(tmp_path: Path, top: str) -> None:
    file = zipped(tmp_path / "s.zip", {f"{top}session.json": b"{}", f"{top}fast/a.csv": b"time\n"})
    with unpacked(file) as folder:
        assert folder.name == top.rstrip("/") or folder.name == "s"
        assert (folder / "session.json").read_bytes() == b"{}"
        assert (folder / "fast" / "a.csv").read_bytes() == b"time\n"
    assert not folder.exists()


@pytest.mark.parametrize(
    "inner",
    [
        "../a.csv",
        "/etc/a.csv",
        "x/../../a.csv",
        "C:/a.csv",
        "..\\a.csv",
        "a\x00.csv",
        "a" * 300,
        "x/" * 9 + "a.csv",
    ],
)
def test_a_path_that_leaves_the_folder_is_refused(tmp_path: Path, inner: str) -> None:
    member = zipfile.ZipInfo("placeholder")
    member.filename = inner
    with zipfile.ZipFile(tmp_path / "s.zip", "w") as packed:
        packed.writestr(member, b"")
    refused(tmp_path / "s.zip", "no path inside")


def test_a_file_without_a_name_is_refused(tmp_path: Path) -> None:
    file = zipped(tmp_path / "s.zip", {"session.json": b"{}", "X": b""})
    file.write_bytes(file.read_bytes().replace(b"X", b"\x00"))
    refused(file, "no path inside")


def test_a_link_is_refused(tmp_path: Path) -> None:
    member = zipfile.ZipInfo("a.csv")
    member.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "s.zip", "w") as packed:
        packed.writestr(member, b"/etc/passwd")
    refused(tmp_path / "s.zip", "is a link")


def test_a_bomb_is_refused_while_it_unpacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zips, "RATIO_FROM", 1_000_000)
    file = zipped(tmp_path / "s.zip", {"a.csv": bytes(30_000_000)})
    refused(file, "more than a recording takes")


def test_a_bomb_that_lies_about_its_size_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zips, "RATIO_FROM", 1_000_000)
    file = zipped(tmp_path / "s.zip", {"a.csv": bytes(3_000_000)})
    content = file.read_bytes()
    size = (3_000_000).to_bytes(4, "little")
    assert content.count(size) == 2
    file.write_bytes(content.replace(size, (10).to_bytes(4, "little")))
    refused(file, "damaged|more than a recording takes")


def test_many_small_files_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "LIMITS", replace(archives.LIMITS, unpacked=2_000))
    refused(zipped(tmp_path / "s.zip", {f"{i}.csv": bytes(500) for i in range(5)}), "more than")


def test_too_many_files_are_refused(tmp_path: Path) -> None:
    refused(zipped(tmp_path / "s.zip", {f"{i}.csv": b"" for i in range(501)}), "at most 500")


def test_one_name_twice_is_refused(tmp_path: Path) -> None:
    refused(
        zipped(tmp_path / "s.zip", {"a.csv": b"1", "A.csv": b"2"}),
        "holds 'a.csv' and 'A.csv', which differ in capitals alone",
    )
    again = zipped(tmp_path / "u.zip", {"a.csv": b"1", "b.csv": b"2"})
    again.write_bytes(again.read_bytes().replace(b"b.csv", b"a.csv"))
    refused(again, "holds 'a.csv' twice")
    refused(zipped(tmp_path / "t.zip", {"a": b"1", "a/b.csv": b"2"}), "a file and a folder")


def test_of_two_sessions_in_one_file_it_is_said_where_they_are(tmp_path: Path) -> None:
    both = {"b/session.json": b"{}", "a/session.json": b"{}"}
    refused(zipped(tmp_path / "s.zip", both), "holds session.json in a, b, and has to hold one")
    refused(zipped(tmp_path / "t.zip", {"a/x.csv": b""}), "holds no session.json")


def test_an_encrypted_file_is_refused(tmp_path: Path) -> None:
    file = zipped(tmp_path / "s.zip", {"a.csv": b"time\n"})
    file.write_bytes(encrypted(file.read_bytes()))
    refused(file, "encrypted")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda content: b"not a zip", "neither a folder nor a zip"),
        (lambda content: content[:20], "neither a folder nor a zip"),
        (lambda content: content.replace(b"AAAA", b"AAAB", 1), "damaged"),
        # The index names a place before the file's first byte, and another way of packing.
        (lambda content: content[:-6] + b"\xff" + content[-5:], "damaged"),
        (lambda content: packed_by(content, 12), "damaged"),
        (lambda content: packed_by(content, 14), "damaged"),
    ],
)
def test_what_is_no_sound_zip_is_said(
    tmp_path: Path, spoil: Callable[[bytes], bytes], words: str
) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as packed:
        packed.writestr("session.json", b"AAAA")
    (tmp_path / "s.zip").write_bytes(spoil(buffer.getvalue()))
    refused(tmp_path / "s.zip", words)


def test_a_part_of_a_session_and_a_log_are_told_from_one(tmp_path: Path) -> None:
    for name, words in (("session.json", "name the folder"), ("a.csv", "`rehyb inspect a.csv")):
        (tmp_path / name).write_text("time")
        refused(tmp_path / name, words)


def test_a_zip_without_a_session_is_said(tmp_path: Path) -> None:
    refused(zipped(tmp_path / "s.zip", {"x/a.csv": b"", "y/session.json": b""}), "json in y, ")


def packed_by(content: bytes, method: int) -> bytes:
    """Return a zip file of one member that says it is packed by another method."""
    spoilt = bytearray(content)
    for mark, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        spoilt[spoilt.index(mark) + offset] = method
    return bytes(spoilt)


def refused(file: Path, words: str) -> None:
    """The one error names the file, and no scratch folder is left."""
    with pytest.raises(SessionError, match=words) as caught, unpacked(file):
        pass
    assert caught.value.file == file.name
    assert not list(Path(tempfile.gettempdir()).iterdir())
