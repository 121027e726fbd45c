"""A backup becomes the database, whatever the old one left behind, or nothing is changed."""

import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rehyb.cli import main
from server.instance_lock import instance_lock
from server.operations import check
from server.store import create_engine, upgrade

Run = Callable[..., tuple[int, str, str]]
#: Changes a database and is killed, as by a power cut: its log stays.
KILLED = """
import os, signal, sqlite3, sys
opened = sqlite3.connect(sys.argv[1])
opened.execute("CREATE TABLE written_since (x)")
opened.commit()
os.kill(os.getpid(), signal.SIGKILL)
"""
#: Has a database open until its input ends.
OPEN = """
import sqlite3, sys
opened = sqlite3.connect(sys.argv[1])
opened.execute("SELECT count(*) FROM studies").fetchone()
print("open", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A database that was backed up, changed and killed."""
    file = tmp_path / "rehyb.sqlite3"
    url = f"sqlite:///{file}"
    upgrade(url)
    monkeypatch.setenv("REHYB_DATABASE_URL", url)
    engine = create_engine(url)
    check.back_up(engine, tmp_path / "backup")
    engine.dispose()
    subprocess.run([sys.executable, "-c", KILLED, file], check=False)
    assert Path(f"{file}-wal").stat().st_size
    return file


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command of `rehyb`; returns its exit status, output and errors."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["rehyb", *arguments])
        with pytest.raises(SystemExit) as leaving:
            main()
        return int(leaving.value.code or 0), *capsys.readouterr()

    return run


def tables(file: Path) -> set[str]:
    with closing(sqlite3.connect(file)) as opened:
        return {name for (name,) in opened.execute("SELECT name FROM sqlite_master")}


def test_a_restored_backup_is_not_undone_by_the_log_of_the_database_that_was_killed(
    file: Path, run: Run
) -> None:
    file.chmod(0o644)
    backup = file.with_name("backup")
    status, out, err = run("db", "restore", str(backup))
    assert (status, err) == (0, "")
    assert out.startswith(f"{backup} is whole, and now is the database {file}")
    assert {path.name for path in file.parent.iterdir()} == {"rehyb.sqlite3", "backup"}
    assert file.stat().st_mode & 0o777 == 0o600
    assert "written_since" not in tables(file)
    assert run("db", "check") == (0, "the database is whole\n", "")


def test_a_database_that_is_lost_is_restored_too(file: Path, run: Run) -> None:
    file.unlink()
    assert run("db", "restore", str(file.with_name("backup")))[0] == 0
    assert "studies" in tables(file)


def test_nothing_is_restored_while_a_coordinator_or_another_process_has_the_database(
    file: Path, run: Run
) -> None:
    backup = str(file.with_name("backup"))
    with instance_lock(f"sqlite:///{file}"):
        status, _, err = run("db", "restore", backup)
    assert status == 1 and err.startswith(
        "rehyb: a coordinator, or a `rehyb db` command, is at work on"
    )
    with subprocess.Popen(
        [sys.executable, "-c", OPEN, file], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == b"open\n"
        status, _, err = run("db", "restore", backup)
        assert other.stdin is not None
        other.stdin.close()
    assert status == 1 and "as `rehyb analysis` has: stop it first" in err
    assert "written_since" in tables(file)


@pytest.mark.parametrize(
    ("damage", "ends", "said"),
    [
        (lambda backup: backup.unlink(), 2, "there is no backup"),
        (lambda backup: (backup.unlink(), backup.mkdir()), 2, "backup is a folder: name a copy"),
        (lambda backup: os.truncate(backup, 0), 2, "is no database of rehyb: name a copy"),
        (lambda backup: backup.write_bytes(b"x" * 9000), 2, "is no SQLite database (file is not"),
        (lambda backup: os.truncate(backup, 40_000), 1, "malformed"),
        (lambda backup: shutil.copy(backup, f"{backup}-wal"), 1, "is in use, or no copy"),
    ],
)
def test_a_backup_that_is_not_whole_replaces_nothing(
    file: Path, run: Run, damage: Callable[[Path], object], ends: int, said: str
) -> None:
    damage(file.with_name("backup"))
    status, out, err = run("db", "restore", str(file.with_name("backup")))
    assert (status, out) == (ends, "") and said in err and err.count("\n") == 1
    assert not list(file.parent.glob("*.partial*"))
    assert "written_since" in tables(file)


def test_a_folder_that_takes_no_copy_is_one_sentence(
    file: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{file}/none")
    status, _, err = run("db", "restore", str(file.with_name("backup")))
    assert status == 2 and err.endswith(f"to the folder of {file}/none: Not a directory\n")


def test_a_database_is_no_backup_of_itself(file: Path, run: Run) -> None:
    assert run("db", "restore", str(file)) == (
        2,
        "",
        f"rehyb: {file} is the database itself: name a backup\n",
    )
