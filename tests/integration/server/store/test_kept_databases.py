"""Databases as earlier versions of the coordinator left them, kept in the folder `schemas`.

Each holds studies made over REST with the code of its time: one done with a failure (0002: which
is to run again), one under way with a contradiction and a lease still held, and since 0002 a
paused one with priority and tags. 0006 holds those of 0005, served by a coordinator of its time.
"""

import shutil
from pathlib import Path

import pytest
from alembic import command
from alembic.script import ScriptDirectory
from sqlalchemy.engine import Engine

from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import leases
from server.operations.study import studies
from server.store import create_engine, upgrade
from server.store.database.engine import reading, writing
from server.store.database.upgrade import _config
from tests.testbed.coordinators import exchanges

KEPT = sorted((Path(__file__).parent / "schemas").glob("*.sqlite3"))
VERSIONS = {
    "mujoco": "4.0.1",
    "code": "c0de",
    "numpy": "2.4",
    "platform": "Linux-x86_64",
    "canary": "0",
}


def counted(engine: Engine) -> dict[str, tuple[str, int, int, int]]:
    return {
        study.plan.name: (study.state, study.result_count, study.ok_count, study.leased)
        for study in studies.every(engine)
    }


def work_off(engine: Engine, now: float) -> None:
    """Evaluate whatever there is for a worker like those of the time."""
    asked = {"host": "pc-w", "versions": VERSIONS, "models": ["ishigami"]}
    while grant := exchanges.grant(engine, worker="w", max_instances=9, now=now, ttl=60.0, **asked):  # type: ignore[arg-type]
        held = grant.lease
        reports = [
            Report(
                instance=instance_id(held.study, *place),
                outcome="ok",
                outputs={"y": 1.0},
                reason="",
                state=None,
                wall_seconds=0.1,
            )
            for place in held.instances
        ]
        proof = {"lease_id": held.id, "fence": held.fence, "worker": "w"}
        verdicts = exchanges.post(engine, reports, now=now, ttl=60.0, **proof)  # type: ignore[arg-type]
        assert {verdict.verdict for verdict in verdicts} == {"accepted"}


def test_every_schema_but_the_newest_has_a_database_that_was_kept(url: str) -> None:
    engine = create_engine(url)
    with reading(engine) as connection:
        script = ScriptDirectory.from_config(_config(connection))
        revisions = {revision.revision for revision in script.walk_revisions()}
        assert {path.stem for path in KEPT} == revisions - {script.get_current_head()}
    engine.dispose()


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.stem)
def test_a_database_that_was_kept_comes_up_to_date_goes_back_and_is_worked_off(
    kept: Path, tmp_path: Path
) -> None:
    path = tmp_path / "rehyb.sqlite3"
    shutil.copy(kept, path)
    url = f"sqlite:///{path}"
    upgrade(url)
    engine = create_engine(url)
    assert check.faults(engine) == []
    before = counted(engine)
    assert before["under way"] == ("running", 7, 7, 2)
    assert before["done"][1:3] == ((8, 7) if kept.stem == "0001" else (7, 7))
    with writing(engine) as connection:
        command.downgrade(_config(connection), kept.stem)
    upgrade(url)
    assert check.faults(engine) == []
    assert counted(engine) == before
    # What the vanished worker held comes back first.
    leases.reap(engine, now=1e12, ttl=60.0)
    work_off(engine, now=1e12)
    after = counted(engine)
    assert {after["done"][0], after["under way"][0]} == {"complete"}
    assert after["under way"][1:] == (20, 20, 0)
    assert after.get("paused", ("paused", 0, 0, 0)) == ("paused", 0, 0, 0)
    assert check.faults(engine) == []
    engine.dispose()
