"""The power fails after every commit of a study: no file is corrupt, and `full` loses nothing."""

import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import apsw
import pytest
import sqlalchemy as sa

from server.logic.study.points import instance_id
from server.operations import check
from server.operations.study import studies
from server.settings import Settings
from server.store import create_engine, upgrade
from tests.testbed.coordinators import exchanges, records
from tests.testbed.coordinators.forgetful_disk import Disk, ForgetfulVFS
from tests.testbed.coordinators.postgresql import Server, serving

#: Ways in which each commit's writes that were not synced fare, besides that all are forgotten.
CUTS = int(os.environ.get("REHYB_POWER_CUTS", "1"))
#: So few pages of the log that it is copied into the file many times.
LOG_PAGES = 40


@pytest.fixture(scope="module")
def statements(upgraded_file: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What a coordinator has SQLite execute for a study of 200 instances, from lease to result."""
    file = tmp_path_factory.mktemp("study") / "rehyb.sqlite3"
    engine = create_engine(f"sqlite:///{shutil.copyfile(upgraded_file, file)}")
    told: list[str] = []
    sa.event.listen(engine, "connect", lambda driver, _: driver.set_trace_callback(told.append))
    study, _ = studies.create(engine, records.plan(rows=50), key=None, digest="", now=0.0)
    assert study.plan.instances == 200
    for now in range(20):
        held = exchanges.grant(
            engine,
            worker="w",
            host="h",
            versions={},
            models=["ishigami"],
            max_instances=10,
            now=float(now),
            ttl=60.0,
        )
        assert held is not None
        reports = [
            records.report(instance_id(study.id, *place), outputs={"y": 1.0})
            for place in held.lease.instances
        ]
        assert {*exchanges.hand_in(engine, held.lease, reports)} == {"accepted"}
    assert check.faults(engine) == []
    engine.dispose()
    return [one for one in told if not one.startswith(("PRAGMA", "SELECT", "--", "WITH"))]


@pytest.mark.parametrize("durability", ["normal", "full"])
def test_after_a_power_cut_nothing_is_corrupt_and_with_full_nothing_is_missing(
    durability: str, statements: list[str], upgraded_file: Path, tmp_path: Path
) -> None:
    file, found = tmp_path / "rehyb.sqlite3", tmp_path / "found"
    shutil.copyfile(upgraded_file, file)
    disk = Disk()
    disk.holds(file)
    name = f"forgetful-{durability}"
    vfs = ForgetfulVFS(name, disk)
    rng = random.Random(20261121)
    lost, boundaries = 0, 0
    connection = apsw.Connection(str(file), vfs=name)
    for setting in (f"synchronous = {durability}", f"wal_autocheckpoint = {LOG_PAGES}"):
        connection.execute(f"PRAGMA {setting}")
    for statement in statements:
        connection.execute(statement).fetchall()
        if statement != "COMMIT":
            continue
        boundaries += 1
        kept = connection.execute("SELECT count(*) FROM results").fetchall()[0][0]
        for fates in [None, *[rng] * CUTS]:
            shutil.rmtree(found, ignore_errors=True)
            found.mkdir()
            disk.after_power_loss(found, fates)
            engine = create_engine(f"sqlite:///{found / file.name}")
            assert check.faults(engine) == []
            with engine.connect() as after:
                there = after.exec_driver_sql("SELECT count(*) FROM results").scalar()
            engine.dispose()
            lost = max(lost, kept - there)
    connection.close()
    vfs.unregister()
    assert boundaries >= 41
    # Under `normal` the disk must have had something to forget, or nothing was tested.
    assert (lost == 0) == (durability == "full")


@pytest.fixture(scope="module")
def careless() -> Iterator[Server]:
    """A PostgreSQL server that does not wait for the disk, and is slow to write at all."""
    with serving(("synchronous_commit=off", "wal_writer_delay=10s", "autovacuum=off")) as server:
        yield server


@pytest.mark.parametrize("durability", ["normal", "full"])
def test_after_a_power_cut_postgresql_has_all_that_was_acknowledged_under_full(
    durability: str, careless: Server
) -> None:
    """It is killed with all of its processes after some of the commits."""
    url = careless.database(f"rehyb_{durability}")
    upgrade(url)
    engine = create_engine(url, durability=durability)
    study, _ = studies.create(engine, records.plan(rows=50), key=None, digest="", now=0.0)
    server_has_written_all(engine)
    acknowledged, lost = 0, 0
    for cut in range(2 * CUTS):
        # After every result's commit, if there are cuts enough.
        for number in range(1 + cut % 4 if CUTS == 1 else 1):
            now = 100.0 * cut + number
            held = exchanges.grant(
                engine,
                worker="w",
                host="h",
                versions={},
                models=["ishigami"],
                max_instances=5,
                now=now,
                ttl=1e6,
            )
            if held is None:
                break
            reports = [
                records.report(instance_id(study.id, *place), outputs={"y": 1.0})
                for place in held.lease.instances
            ]
            told = exchanges.hand_in(engine, held.lease, reports, now=now)
            acknowledged += told.count("accepted")
        engine.dispose()
        before = careless.pid
        careless.crash()
        # What counts a server's processor time by it counts the new one's.
        assert careless.pid != before
        engine = create_engine(url, durability=durability)
        assert check.faults(engine) == []
        there = studies.get(engine, study.id).result_count
        lost += acknowledged - there
        acknowledged = there
    engine.dispose()
    # Under `normal` there must have been something to lose, or nothing was tested.
    assert (lost == 0) == (durability == "full")


def server_has_written_all(engine: sa.Engine) -> None:
    """Make the making of the study safe, which is not what is tested."""
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.exec_driver_sql("CHECKPOINT")


@pytest.mark.parametrize(("durability", "synchronous"), [("normal", 1), ("full", 2)])
def test_the_setting_reaches_every_connection(
    durability: str, synchronous: int, tmp_path: Path
) -> None:
    assert Settings.model_fields["durability"].default == "normal"
    engine = create_engine(f"sqlite:///{tmp_path / 'x'}", durability=durability)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == synchronous
    engine.dispose()
