"""A file is written whole or not at all, and nothing else in its place is replaced."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from rehyb.errors import Invalid
from rehyb.whole_files import whole_file
from tests.testbed.coordinators.finished_study import FinishedStudy


def write(path: Path) -> None:
    with whole_file(path) as partial:
        partial.write_text("new")


def test_what_is_no_regular_file_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("fifo")
    (tmp_path / "null").symlink_to(os.devnull)
    for name in ("fifo", "folder", "link", "null", "folder/../fifo"):
        with pytest.raises(Invalid, match=f"{name} is no regular file; name a file"):
            write(tmp_path / name)
    assert stat.S_ISFIFO((tmp_path / "fifo").stat().st_mode)
    assert Path(os.devnull).is_char_device()
    assert not list(tmp_path.glob("*.partial"))


def test_what_a_link_leads_to_is_written(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("old")
    for target in ("old", "new"):
        link = tmp_path / f"to-{target}"
        link.symlink_to(target)
        write(link)
        assert link.is_symlink()
        assert (tmp_path / target).read_text() == "new"
    assert not list(tmp_path.glob("*.partial"))


def test_of_two_that_write_one_file_at_once_the_last_one_s_is_there_whole(tmp_path: Path) -> None:
    """They shared what was not yet whole: an export had lines of two studies, and ended well."""
    with whole_file(tmp_path / "x") as one, whole_file(tmp_path / "x") as other:
        one.write_text("one")
        other.write_text("other")
    assert (tmp_path / "x").read_text() == "one"
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


def test_an_error_names_the_file_that_was_meant_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for name, cause in (("none/x", "No such file"), ("file/x", "Not a directory")):
        with pytest.raises(OSError, match=cause) as raised:
            write(tmp_path / name)
        assert raised.value.filename == str(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_disk_that_is_full_names_the_file(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match=r"No space left on device: '.*/x'$"),
        whole_file(tmp_path / "x"),
        Path("/dev/full").open("wb", buffering=0) as full,
    ):
        full.write(b"x")
    assert not list(tmp_path.iterdir())


def test_an_error_about_another_file_keeps_its_name(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="other"), whole_file(tmp_path / "x"):
        (tmp_path / "other").read_text()


@pytest.mark.parametrize(
    "command",
    [
        "study export s1",
        "study export s1 --format parquet",
        "study export s1 --format netcdf",
        "bundle s1",
        "report s1",
    ],
)
def test_no_command_replaces_a_fifo_or_names_a_file_that_nobody_typed(
    command: str,
    run: Callable[..., tuple[int, str, str]],
    talk_to: Callable[[FinishedStudy], None],
    tmp_path: Path,
) -> None:
    talk_to(FinishedStudy())
    os.mkfifo(tmp_path / "fifo")
    for place, said, status in (
        ("fifo", "{} is no regular file; name a file", 2),
        ("none/x", "{}: No such file or directory", 2),
    ):
        path = str(tmp_path / place)
        answer = run(*command.split(), "--out", path)
        assert answer == (status, "", f"rehyb: {said.format(path)}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["fifo"]
    assert stat.S_ISFIFO((tmp_path / "fifo").stat().st_mode)
