"""Exit status: 2 for what is not there or not what a command takes, 1 for what failed."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

Run = Callable[..., tuple[int, str, str]]
LOG = "time,elbow.position,elbow.effort\n" + "".join(f"{i / 100},{i},1\n" for i in range(300))


@pytest.mark.parametrize(
    "command",
    [
        "reproduce nothere.zip --check",
        "reproduce . --check",
        "reproduce log.csv --check",
        "inspect nothere.csv",
        "inspect log.csv --model nothere.xml",
        "analyse nothere.csv --output y",
        "analyse . --output y",
        "close-loop nothere --out out",
        "close-loop log.csv --out out",
        "interpret nothere.npz",
        "study submit nothere.json",
        "study with-effect nothere.json",
        "study of-session nothere nothere",
        "model check nothere",
        "assess --replay nothere.json",
        "assess --set nothing=1",
    ],
)
def test_what_is_not_there_or_not_what_a_command_takes_is_status_2(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(LOG)
    status, out, err = run(*command.split())
    assert (status, out) == (2, "") and err and "Traceback" not in err


def somebody_elses(file: Path) -> None:
    """Make a database that is not rehyb's."""
    with closing(sqlite3.connect(file)) as made:
        made.execute("CREATE TABLE foo (x)")


@pytest.mark.parametrize(
    ("database", "said"),
    [
        ("nothere.sqlite3", "there is no database"),
        ("folder", "is a folder"),
        ("theirs.sqlite3", "it holds other tables (foo); name another file"),
        ("log.csv", "log.csv is no SQLite database of rehyb (file is not a database)"),
    ],
)
@pytest.mark.parametrize(
    "command", ["db check", "db backup b", "token list", "token create anna --scope read"]
)
def test_a_database_that_is_none_is_status_2_and_nobody_is_sent_to_a_backup(
    command: str,
    database: str,
    said: str,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(LOG)
    Path("folder").mkdir()
    somebody_elses(Path("theirs.sqlite3"))
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{database}")
    status, out, err = run(*command.split())
    assert (status, out) == (2, "") and said in err and "restore" not in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("command", ["db upgrade", "db check", "coordinator"])
@pytest.mark.parametrize(
    ("statements", "said"),
    [
        (["CREATE TABLE foo (x)"], "it holds other tables (foo); name another file"),
        (["CREATE VIEW shown AS SELECT 1"], "it holds other views (shown); name another"),
        (["PRAGMA user_version = 7"], "has put its number in it (user_version 7); name another"),
        (["PRAGMA application_id = 9"], "has put its number in it (application_id 9); name"),
        (["CREATE TABLE studies (x)"], "it holds other tables (studies); name another"),
        (
            # As Optuna keeps its own.
            [
                "CREATE TABLE studies (x)",
                "CREATE TABLE trials (x)",
                "CREATE TABLE alembic_version (version_num VARCHAR(32))",
                "INSERT INTO alembic_version VALUES ('v3.2.0.a')",
            ],
            "it holds other tables (studies, trials); name another",
        ),
        (
            ["CREATE TABLE alembic_version (version_num VARCHAR(32))"],
            "it holds other tables (alembic_version); name another",
        ),
    ],
)
def test_nothing_is_written_into_a_database_of_somebody_else(
    statements: list[str],
    said: str,
    command: str,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "theirs.sqlite3"
    with closing(sqlite3.connect(file)) as made, made:
        for statement in statements:
            made.execute(statement)
    before = file.read_bytes()
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{file}")
    status, _, err = run(*command.split())
    assert status == 2 and said in err and err.count("rehyb: ") == 1
    assert file.read_bytes() == before


def test_whose_file_is_somebody_else_s_is_said_by_what_named_it(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("REHYB_DATABASE_URL", "sqlite:///ours.sqlite3")
    run("db", "upgrade")
    somebody_elses(Path("theirs.sqlite3"))
    assert run("db", "restore", "theirs.sqlite3") == (
        2,
        "",
        "rehyb: theirs.sqlite3 is no database of rehyb (it holds other tables (foo)): name a copy "
        "by `rehyb db backup`; nothing is replaced\n",
    )
    said = "rehyb: the database is not rehyb's: it holds other tables (foo); name another file or "
    assert run("db", "copy", "sqlite:///theirs.sqlite3") == (
        2,
        "",
        f"{said}database as the target\n",
    )
    monkeypatch.setenv("REHYB_DATABASE_URL", "sqlite:///theirs.sqlite3")
    assert run("db", "check") == (2, "", f"{said}database by REHYB_DATABASE_URL\n")


def test_a_coordinator_on_a_text_file_is_told_that_it_is_no_database(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "log.csv").write_text(LOG)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{tmp_path}/log.csv")
    status, _, err = run("coordinator")
    assert status == 2 and "log.csv is no SQLite database of rehyb" in err
    assert "restore" not in err and (tmp_path / "log.csv").read_text() == LOG


@pytest.mark.parametrize("file", ["log.csv", "folder"])
def test_a_backup_onto_what_is_there_is_status_2(
    file: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("REHYB_DATABASE_URL", "sqlite:///a.sqlite3")
    run("db", "upgrade")
    Path("log.csv").write_text(LOG)
    Path("folder").mkdir()
    status, _, err = run("db", "backup", file)
    assert status == 2 and ("exists" in err or "is a folder: name a file in it" in err)


def test_a_file_as_the_folder_of_a_campaign_is_status_2_and_says_what_is_needed(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(LOG)
    status, _, err = run("campaign", "run", "--directory", "log.csv")
    assert status == 2
    assert err == (
        "rehyb: log.csv is no folder, which a campaign needs for what it keeps: name one, or one "
        "to be made\n"
    )


@pytest.mark.parametrize("command", ["study list", "study show s1", "report s1 --out r.html"])
def test_a_coordinator_that_is_away_is_status_1(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*command.split(), "--url", "http://127.0.0.1:9")[0] == 1


def test_a_models_folder_that_is_not_there_is_named(run: Run, tmp_path: Path) -> None:
    there = str(tmp_path / "nothere")
    for command in ("check", "add"):
        found = run("model", command, there)
        assert found == (2, "", f"rehyb: {there}: there is no such folder\n")
