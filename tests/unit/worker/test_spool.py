"""A finished result is on disk until the coordinator has acknowledged it."""

import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from rehyb.errors import RehybError
from worker.spool import Spool

DIES_WITH_RESULTS = """
import os, sys
from pathlib import Path
from worker.spool import Spool
spool = Spool(Path(sys.argv[1]), "dead")
for i in range(3):
    spool.add([("lease-a", 4, {"instance": f"i{i}", "outputs": {"y": 0.1 + i}})])
os._exit(9)
"""


def result(instance: str) -> dict[str, object]:
    return {"instance": instance, "outcome": "ok", "outputs": {"y": 0.1}}


def test_a_new_spool_has_nothing_to_post(tmp_path: Path) -> None:
    assert Spool(tmp_path, "w").next_batch() is None


def test_a_folder_that_takes_no_file_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "w.spool").mkdir()
    with pytest.raises(RehybError, match=r"cannot wait in .*: unable to open database file; name"):
        Spool(tmp_path, "w")


def test_results_of_one_lease_are_posted_together_oldest_first(tmp_path: Path) -> None:
    spool = Spool(tmp_path, "w")
    for lease, instance in (("a", "1"), ("b", "2"), ("a", "3")):
        spool.add([(lease, 1, result(instance))])
    first = spool.next_batch()
    assert first is not None
    assert (first.lease, first.worker) == ("a", "w")
    assert [r["instance"] for r in first.results] == ["1", "3"]
    spool.acknowledge(first.keys)
    second = spool.next_batch()
    assert second is not None
    assert (second.lease, [r["instance"] for r in second.results]) == ("b", ["2"])


def test_a_batch_is_offered_again_until_it_is_acknowledged(tmp_path: Path) -> None:
    spool = Spool(tmp_path, "w")
    spool.add([("a", 1, result("1"))])
    batch = spool.next_batch()
    assert batch is not None
    assert spool.next_batch() == batch
    spool.acknowledge(batch.keys)
    assert spool.next_batch() is None


def test_what_is_set_aside_lets_others_pass_and_can_be_brought_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, "w")
    spool.add([("a", 1, result("on disk"))])
    with monkeypatch.context() as full:
        full.setattr(spool, "_insert", _no_room)
        spool.add([("b", 2, result("in memory"))])
    for expected in ("on disk", "in memory"):
        batch = spool.next_batch()
        assert batch is not None
        assert [r["instance"] for r in batch.results] == [expected]
        spool.set_aside(batch.keys)
    assert spool.next_batch() is None
    assert len(spool) == 2
    assert spool.bring_back() == 2
    assert spool.next_batch() is not None


def _no_room(_rows: object) -> None:
    raise sqlite3.OperationalError("database or disk is full")


def test_a_batch_is_no_longer_than_asked(tmp_path: Path) -> None:
    spool = Spool(tmp_path, "w")
    for i in range(5):
        spool.add([("a", 1, result(str(i)))])
    batch = spool.next_batch(limit=2)
    assert batch is not None
    assert [r["instance"] for r in batch.results] == ["0", "1"]


def test_results_of_a_worker_that_died_are_adopted_with_its_name_and_fence(tmp_path: Path) -> None:
    died = subprocess.run([sys.executable, "-c", DIES_WITH_RESULTS, str(tmp_path)], check=False)
    assert died.returncode == 9
    spool = Spool(tmp_path, "heir")
    assert spool.adopt() == 3
    batch = spool.next_batch()
    assert batch is not None
    assert (batch.lease, batch.fence, batch.worker) == ("lease-a", 4, "dead")
    assert [r["outputs"]["y"] for r in batch.results] == [0.1, 1.1, 2.1]
    assert [path.name for path in tmp_path.glob("*.spool")] == ["heir.spool"]


def left_by(folder: Path, worker: str, *instances: str) -> Path:
    """Leave results of a worker that is gone, and return their file."""
    dead = Spool(folder, worker)
    dead.add([("a", 1, result(instance)) for instance in instances])
    dead.close()
    return folder / f"{worker}.spool"


def test_every_dead_worker_s_results_are_adopted_past_what_cannot_be(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    living = Spool(tmp_path, "a")
    living.add([("a", 1, result("1"))])
    stray = tmp_path / "b.spool"
    stray.write_text("this is not a database, and long enough to be taken for the header of one")
    spool = Spool(tmp_path, "c")
    left_by(tmp_path, "d", "2")
    left_by(tmp_path, "e", "3", "4")
    assert spool.adopt() == 3
    assert len(spool) == 3
    # One that lives is nobody's business.
    assert caplog.messages == [f"{stray} is not a spool: file is not a database"]


def test_what_does_not_fit_is_left_where_it_is_and_the_next_is_adopted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    large, small = left_by(tmp_path, "large", "1", "2"), left_by(tmp_path, "small", "3")
    spool = Spool(tmp_path, "heir")
    insert = spool._insert
    monkeypatch.setattr(
        spool, "_insert", lambda rows: _no_room(rows) if len(rows) > 1 else insert(rows)
    )
    assert spool.adopt() == 1
    assert large.exists() and not small.exists()
    assert caplog.messages == [f"{large} cannot be adopted: database or disk is full"]
    monkeypatch.undo()
    assert spool.adopt() == 2


def test_results_of_a_worker_that_lives_are_left_alone(tmp_path: Path) -> None:
    living = Spool(tmp_path, "living")
    living.add([("a", 1, result("1"))])
    assert Spool(tmp_path, "other").adopt() == 0
    assert len(living) == 1


def test_two_workers_cannot_share_a_spool(tmp_path: Path) -> None:
    first = Spool(tmp_path, "w")
    with pytest.raises(RehybError, match="locked"):
        Spool(tmp_path, "w")
    first.close()


def test_closing_keeps_what_is_not_acknowledged_and_removes_an_empty_file(tmp_path: Path) -> None:
    full, empty = Spool(tmp_path, "full"), Spool(tmp_path, "empty")
    full.add([("a", 1, result("1"))])
    full.close()
    empty.close()
    assert [path.name for path in tmp_path.iterdir()] == ["full.spool"]
    assert len(Spool(tmp_path, "full")) == 1


def test_a_file_that_is_no_spool_is_left_alone(tmp_path: Path) -> None:
    stray = tmp_path / "stray.spool"
    stray.write_text("this is not a database, and long enough to be taken for the header of one")
    assert Spool(tmp_path, "w").adopt() == 0
    assert stray.exists()


def full(spool: Spool) -> None:
    """Leave the spool's file no room to grow."""
    pages = spool._database.execute("PRAGMA page_count").fetchone()[0]
    spool._database.execute(f"PRAGMA max_page_count = {pages}")


def test_a_full_disk_costs_no_result(tmp_path: Path) -> None:
    spool = Spool(tmp_path, "w")
    spool.add([("a", 1, result("0"))])
    full(spool)
    for number in range(1, 40):
        spool.add([("b", 2, {**result(str(number)), "reason": "x" * 1000})])
    assert len(spool) == 40
    posted: list[str] = []
    while batch := spool.next_batch(limit=7):
        posted += [str(r["instance"]) for r in batch.results]
        assert {batch.lease} == ({"a"} if posted == ["0"] else {"b"})
        spool.acknowledge(batch.keys)
    assert posted == [str(number) for number in range(40)]
    assert len(spool) == 0


def test_what_is_in_memory_is_kept_apart_by_lease_and_from_what_is_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    spool = Spool(tmp_path / "made" / "if missing", "w")
    spool.add([("a", 1, result("0"))])
    monkeypatch.setattr(spool, "_insert", _no_room)
    spool.add([("b", 2, result(name)) for name in "123"])
    assert len(caplog.messages) == 1
    spool.add([("c", 3, result("4"))])
    posted: list[tuple[str, list[object]]] = []
    while batch := spool.next_batch():
        posted.append((batch.lease, [one["instance"] for one in batch.results]))
        spool.acknowledge(batch.keys)
    assert posted == [("a", ["0"]), ("b", ["1", "2", "3"]), ("c", ["4"])]
    # Once is enough while it lasts.
    file = tmp_path / "made" / "if missing" / "w.spool"
    assert caplog.messages == [
        f"{file}: database or disk is full; results are kept in memory",
    ]


def test_what_a_full_disk_cannot_forget_is_not_posted_again(tmp_path: Path) -> None:
    spool = Spool(tmp_path, "w")
    spool.add([("a", 1, result("1"))])
    spool.add([("a", 1, result("2"))])
    database = spool._database
    database.execute("PRAGMA query_only = ON")
    batch = spool.next_batch(limit=1)
    assert batch is not None
    spool.acknowledge(batch.keys)
    following = spool.next_batch()
    assert following is not None
    assert [r["instance"] for r in following.results] == ["2"]
    assert len(spool) == 1
    database.execute("PRAGMA query_only = OFF")
    spool.acknowledge(following.keys)
    assert database.execute("SELECT count(*) FROM results").fetchone() == (0,)
    assert (len(spool), spool.next_batch()) == (0, None)
