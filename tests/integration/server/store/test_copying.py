"""A study moves to another database, and nobody who reads its indices can tell."""

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from sqlalchemy.engine import Engine

from analysis.sensitivity.service import catch_up
from rehyb.cli import main
from server.errors import ConflictError
from server.instance_lock import instance_lock
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import leases
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.records import Plan
from server.store import create_engine, upgrade
from server.store.copying import copy
from server.store.database.engine import reading
from server.store.study import snapshots
from tests.testbed.coordinators import exchanges

Moved = tuple[Engine, Engine]


@pytest.fixture
def kind() -> str:
    return "sqlite"


@pytest.fixture
def study_id(
    engine: Engine,
    plan: Callable[..., Plan],
    report: Callable[..., Report],
    lease: Callable[..., Grant],
) -> str:
    """A study of eight rows, half of its results in, some of them analysed, and a lease open."""
    study, _ = studies.create(
        engine, plan(rows=8, fixed={"x2": 1 / 3}), key="k", digest="", now=0.1
    )
    for number in range(16):
        held = lease("w", 1, now=float(number)).lease
        name = instance_id(study.id, *held.instances[0])
        reason = 'an "odd" \\ \u2028 word' if number == 3 else ""
        odd = {"outcome": "slipped", "state": {"t": 1e-300, "z": [1, None]}, "reason": reason}
        found = report(name, outputs={"y": number / 7}, **(odd if number == 3 else {}))
        exchanges.hand_in(engine, held, [found], now=float(number))
        if number == 8:
            catch_up(StoreResultLog(engine), study.id)
    lease("w", 3, now=20.0)
    return study.id


def finish(engine: Engine, study_id: str, report: Callable[..., Report]) -> object:
    """Have a study finished; returns its indices."""
    leases.reap(engine, now=1000.0, ttl=60.0)
    while found := exchanges.grant(
        engine,
        worker="v",
        host="h",
        versions={},
        models=["ishigami"],
        max_instances=50,
        now=2000.0,
        ttl=60.0,
    ):
        places = found.lease.instances
        reports = [
            report(instance_id(study_id, *at), outputs={"y": at[0] / 3 + at[1] ** 0.5})
            for at in places
        ]
        exchanges.hand_in(engine, found.lease, reports, now=2000.0)
    catch_up(StoreResultLog(engine), study_id)
    assert check.faults(engine) == []
    with reading(engine) as connection:
        return snapshots.state(connection, study_id), snapshots.find(connection, study_id)


def test_a_study_moves_to_postgresql_and_back_in_its_midst_and_the_bits_are_the_same(
    engine: Engine,
    study_id: str,
    upgraded_database: Callable[[], str],
    tmp_path: Path,
    report: Callable[..., Report],
) -> None:
    there = create_engine(upgraded_database())
    back_url = f"sqlite:///{tmp_path / 'back.sqlite3'}"
    upgrade(back_url)
    back = create_engine(back_url)
    counts: dict[str, int] = {}
    copy(engine, there, counts.__setitem__)
    assert (counts["studies"], counts["results"], counts["workers"]) == (1, 16, 1)
    copy(there, back, counts.__setitem__)
    assert [check.faults(one) for one in (there, back)] == [[], []]
    for one in (there, back):
        assert studies.get(one, study_id) == studies.get(engine, study_id)
    finals = [finish(one, study_id, report) for one in (engine, there, back)]
    assert finals[0] == finals[1] == finals[2]
    with pytest.raises(ConflictError, match="the target is not empty: it has"):
        copy(engine, there, counts.__setitem__)
    for one in (there, back):
        one.dispose()


def test_the_command_copies_and_checks_and_says_what_is_wrong_in_a_sentence(
    engine: Engine,
    study_id: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    url = engine.url.render_as_string(hide_password=False)
    monkeypatch.setenv("REHYB_DATABASE_URL", url)

    def run(target: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["rehyb", "db", "copy", target, "--json"])
        status = 0
        try:
            main()
        except SystemExit as leaving:
            status = int(leaving.code or 0)
        said = capsys.readouterr()
        return status, said.out, said.err

    engine.dispose()
    target = f"sqlite:///{tmp_path / 'copy.sqlite3'}"
    status, out, _ = run(target)
    assert status == 0
    assert json.loads(out)["faults"] == [] and json.loads(out)["rows"]["results"] == 16
    assert json.loads(out)["other_sessions"] == 0
    for wrong, words in (
        (target, "the target is not empty: it has"),
        ("nonsense", "the one that begins with 'nonsense' cannot be used"),
        ("postgresql+psycopg://nobody@127.0.0.1:1/none", "the database cannot be used"),
        (url, "the target is not empty"),
    ):
        status, _, err = run(wrong)
        assert status in (1, 2) and words in err and len(err.splitlines()) == 1, err
    with instance_lock(url):
        assert (
            "a coordinator, or a `rehyb db` command, is at work on"
            in run(f"sqlite:///{tmp_path / 'other.sqlite3'}")[2]
        )


def test_of_a_postgresql_that_others_have_open_it_is_said_that_the_copy_may_lack_something(
    upgraded_database: Callable[[], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    url = upgraded_database()
    monkeypatch.setenv("REHYB_DATABASE_URL", url)

    def said(name: str, *options: str) -> str:
        target = f"sqlite:///{tmp_path / name}"
        monkeypatch.setattr("sys.argv", ["rehyb", "db", "copy", target, *options])
        with suppress(SystemExit):
            main()
        return capsys.readouterr().out

    # Whoever empties the database between tests has it open.
    before = json.loads(said("alone", "--json"))["other_sessions"]
    coordinator = create_engine(url)
    with reading(coordinator):
        pass
    told = said("beside another")
    coordinator.dispose()
    assert f"sessions that had the database open meanwhile: {before + 1}. What they wrote" in told
