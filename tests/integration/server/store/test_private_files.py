"""Measured sessions are of people: nobody but its owner reads a SQLite database that is made."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy.exc import OperationalError

from server.errors import ConflictError
from server.instance_lock import instance_lock
from server.operations import check
from server.store import create_engine, upgrade
from server.store.audit import write_nothing_new
from server.store.database.engine import writing


@pytest.fixture(autouse=True)
def readable_by_all() -> Iterator[None]:
    """Files are made as on most machines, where everybody may read them."""
    before = os.umask(0o022)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, int]:
    return {file.name: file.stat().st_mode & 0o777 for file in folder.iterdir()}


def test_a_database_its_log_and_its_backup_are_for_their_owner_alone(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'db'}"
    upgrade(url)
    engine = create_engine(url)
    with writing(engine) as connection:
        write_nothing_new(connection)
    check.back_up(engine, tmp_path / "backup")
    found = modes(tmp_path)
    engine.dispose()
    assert found == dict.fromkeys(("db", "db-wal", "db-shm", "backup"), 0o600)


def test_so_is_what_a_coordinator_locks_before_it_makes_it_also_through_a_link(
    tmp_path: Path,
) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "db")
    url = f"sqlite:///{tmp_path / 'link'}"
    with instance_lock(url):
        assert (tmp_path / "db").stat().st_mode & 0o777 == 0o600
        upgrade(url)
    assert modes(tmp_path)["db"] == 0o600


def test_a_file_that_is_there_keeps_its_mode(tmp_path: Path) -> None:
    file = tmp_path / "db"
    file.touch(0o640)
    with instance_lock(f"sqlite:///{file}"):
        upgrade(f"sqlite:///{file}")
    assert modes(tmp_path)["db"] == 0o640


def test_a_database_that_cannot_be_made_is_told_as_before(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'none' / 'db'}"
    with pytest.raises(ConflictError, match="No such file or directory"), instance_lock(url):
        pass
    with pytest.raises(OperationalError, match="unable to open database file"):
        upgrade(url)
