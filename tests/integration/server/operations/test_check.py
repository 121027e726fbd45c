"""The check finds what contradicts itself, and a backup is as good as the original."""

import json
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from rehyb.cli import main
from server.errors import ConflictError, DamagedError
from server.instance_lock import instance_lock
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Plan
from server.store import create_engine, upgrade
from server.store.database.engine import writing
from tests.testbed.coordinators import exchanges


@pytest.fixture
def study_id(
    engine: Engine,
    plan: Callable[..., Plan],
    report: Callable[..., Report],
    lease: Callable[..., Grant],
) -> str:
    """A study of which five instances are leased and three of these done."""
    study, _ = studies.create(engine, plan(), key=None, digest="", now=0.0)
    held = lease("w", 5).lease
    done = [report(instance_id(study.id, *place)) for place in held.instances[:3]]
    exchanges.hand_in(engine, held, done, now=1.0)
    return study.id


def test_a_database_that_worked_is_whole(engine: Engine, study_id: str) -> None:
    assert check.faults(engine) == []


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        ("DELETE FROM results WHERE seq = 2", "results: 2, where 3 would be right"),
        ("UPDATE studies SET ok_count = 7", "ok results: 3, where 7 would be right"),
        ("UPDATE leases SET state = 'expired'", "held by a lease that has ended: 2"),
        ("UPDATE instances SET state = 'done' WHERE state = 'leased'", "are done: 5, where 3"),
        ("UPDATE studies SET state = 'complete'", "it is complete with 3 of 8 results"),
        ("UPDATE instances SET host_class = 'x' WHERE position = 0", "kinds of machines: 2"),
        ("UPDATE results SET seq = 9 WHERE seq = 3", "the last result's number: 9, where 3"),
    ],
)
def test_what_contradicts_itself_is_found(
    engine: Engine, study_id: str, damage: str, fault: str
) -> None:
    with writing(engine) as connection:
        connection.execute(sa.text(damage))
    assert any(fault in found for found in check.faults(engine)), check.faults(engine)


def test_a_backup_is_a_whole_database_and_overwrites_nothing(
    engine: Engine,
    study_id: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    copy = tmp_path / "copy.sqlite3"
    if engine.dialect.name != "sqlite":
        with pytest.raises(ConflictError, match="pg_dump"):
            check.back_up(engine, copy)
        return
    check.back_up(engine, copy)
    with pytest.raises(ConflictError, match="exists: name a new file"):
        check.back_up(engine, copy)
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{copy}")
    monkeypatch.setattr("sys.argv", ["rehyb", "db", "check", "--json"])
    with pytest.raises(SystemExit) as leaving:
        main()
    assert not leaving.value.code
    assert json.loads(capsys.readouterr().out) == {"faults": []}
    copied = create_engine(f"sqlite:///{copy}")
    assert studies.get(copied, study_id) == studies.get(engine, study_id)
    copied.dispose()


def test_a_file_with_damaged_pages_is_refused_at_start(tmp_path: Path) -> None:
    file = tmp_path / "rehyb.sqlite3"
    url = f"sqlite:///{file}"
    upgrade(url)
    # To be cut short is no damage.
    for seconds in (60.0, -1.0):
        check.refuse_damage(url, seconds=seconds)
    with file.open("r+b") as pages:
        pages.seek(0, os.SEEK_END)
        last = pages.tell() // 4096
        for page in range(last // 2, last):
            pages.seek(page * 4096)
            pages.write(b"\xa5" * 4096)
    with pytest.raises(DamagedError, match=r"damaged \(.*rehyb db check"):
        check.refuse_damage(url, seconds=60.0)


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """A database with a damaged page that opening the file does not read."""
    file = tmp_path / "rehyb.sqlite3"
    upgrade(f"sqlite:///{file}")
    with closing(sqlite3.connect(file)) as opened:
        (root,) = opened.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'leases'"
        ).fetchone()
    with file.open("r+b") as pages:
        pages.seek((root - 1) * 4096)
        pages.write(b"\xa5" * 4096)
    return file


def test_a_damaged_page_that_opening_the_file_does_not_read_is_found_too(damaged: Path) -> None:
    with pytest.raises(DamagedError, match=r"damaged \(.*rehyb db check"):
        check.refuse_damage(f"sqlite:///{damaged}", seconds=60.0)


def test_no_backup_is_kept_of_a_database_with_damaged_pages(
    damaged: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{damaged}")
    monkeypatch.setattr("sys.argv", ["rehyb", "db", "backup", str(damaged.with_name("copy"))])
    with pytest.raises(SystemExit) as leaving:
        main()
    said = capsys.readouterr()
    assert (leaving.value.code, said.out) == (1, "")
    assert said.err.startswith("rehyb: the file of the database is damaged (")
    assert said.err.count("\n") == 1
    assert not list(damaged.parent.glob("copy*"))


def test_a_second_coordinator_on_one_file_is_refused(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'a.sqlite3'}"
    with (
        instance_lock(url),
        instance_lock(f"sqlite:///{tmp_path / 'b.sqlite3'}"),
        instance_lock("postgresql+psycopg://h/a"),
        instance_lock("postgresql+psycopg://h/a"),
        pytest.raises(ConflictError, match="a coordinator, or a `rehyb db` command, is at work on"),
        instance_lock(url),
    ):
        raise AssertionError("two coordinators")
    with instance_lock(url):
        pass


def test_of_a_damaged_database_a_check_names_the_file_and_what_to_do(
    damaged: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{damaged}")
    monkeypatch.setattr("sys.argv", ["rehyb", "db", "check"])
    with pytest.raises(SystemExit) as ended:
        main()
    said = "".join(capsys.readouterr())
    assert ended.value.code == 1
    assert str(damaged) in said and "go back to a copy of `rehyb db backup`" in said


@pytest.mark.parametrize("command", ["copy", "upgrade"])
def test_a_damaged_database_is_neither_copied_nor_upgraded(
    command: str,
    damaged: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    target = damaged.with_name("copy")
    given = [f"sqlite:///{target}"] if command == "copy" else []
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{damaged}")
    monkeypatch.setattr("sys.argv", ["rehyb", "db", command, *given])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 1 and said.count("\n") == 1
    assert "is damaged (" in said and "go back to a copy of `rehyb db backup`" in said
    assert not list(damaged.parent.glob("copy*"))


@pytest.mark.parametrize("there", [True, False])
def test_what_cannot_be_copied_is_not_told_and_no_half_of_a_copy_stays(
    there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, target = tmp_path / "rehyb.sqlite3", tmp_path / "copy"
    upgrade(f"sqlite:///{file}")
    if there:
        upgrade(f"sqlite:///{target}")
    with closing(sqlite3.connect(file)) as opened:
        opened.execute(
            "INSERT INTO tokens (id, name, digest, scopes, created_at) "
            "VALUES ('t', 'somebody' || CAST(X'FFFE' AS TEXT), 'd', '[]', 0)"
        )
        opened.commit()
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{file}")
    monkeypatch.setattr("sys.argv", ["rehyb", "db", "copy", f"sqlite:///{target}"])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 1 and said.count("\n") == 1
    assert f"{file} is damaged (table tokens: " in said and "somebody" not in said
    assert "go back to a copy of `rehyb db backup`" in said
    assert bool(list(tmp_path.glob("copy*"))) == there
