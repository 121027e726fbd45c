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
from server.operations.fleet.exchange import Exchange, Grant, LeaseRequest, Post
from server.operations.fleet.turns import serve_within
from server.operations.study import studies
from server.records import Introduction, Study
from server.settings import Settings
from server.store import create_engine, upgrade
from server.store.database.engine import reading, writing
from server.store.fleet import leases
from tests.testbed.coordinators import exchanges, records
from tests.testbed.coordinators.forgetful_disk import Disk, ForgetfulVFS
from tests.testbed.coordinators.postgresql import Server, serving
from tests.testbed.coordinators.turns import Turns

#: Ways in which each commit's writes that were not synced fare, besides that all are forgotten.
CUTS = int(os.environ.get("REHYB_POWER_CUTS", "1"))
#: So few pages of the log that it is copied into the file many times.
LOG_PAGES = 40
#: After so many commits PostgreSQL is killed in the tests: each kind once.
BOUNDARIES = 4


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


class Worker:
    """One that works a study off, one commit at a time, in turns and in transactions of its own."""

    def __init__(self, url: str, durability: str) -> None:
        self.engine = create_engine(url, durability=durability)
        self._turns = Turns(self.engine)
        #: Steps since it was reset, what is under way, and results acknowledged.
        self.state: tuple[int, Grant | None, int] = (0, None, 0)

    def step(self, study: Study) -> bool:
        """Do something that is committed once; say whether anything is left to do."""
        number, held, acknowledged = self.state
        now = float(number)
        alone = number % 3 == 2
        posted = None if held is None else _done(held)
        request = LeaseRequest(
            worker=Introduction(id="w", host="h", versions={}), models=["ishigami"], max_instances=5
        )
        asked = None if alone and posted is not None else request
        exchange = Exchange(posted=posted, request=asked, now=now, ttl=1e6)
        if alone:
            with writing(self.engine) as connection:
                (answer,) = serve_within(connection, [exchange])
        else:
            (answer,) = self._turns.take(study.id, lambda: [exchange]).answers
        judgements, found = answer
        assert {judgement.verdict for judgement in judgements} <= {"accepted"}
        held = found if isinstance(found, Grant) else None
        self.state = (number + 1, held, acknowledged + len(judgements))
        return held is not None or asked is None

    def reconnect(self) -> None:
        """Forget the connections to a server that was killed."""
        self._turns.close()
        self.engine.dispose()
        self._turns = Turns(self.engine)

    def close(self) -> None:
        self._turns.close()
        self.engine.dispose()


def _done(held: Grant) -> Post:
    lease = held.lease
    reports = [records.report(instance_id(held.study.id, *place)) for place in lease.instances]
    return Post(reports=reports, lease=lease.id, fence=lease.fence, worker=lease.worker)


@pytest.mark.parametrize("durability", ["normal", "full"])
def test_after_a_power_cut_postgresql_has_all_that_was_acknowledged_under_full(
    durability: str, careless: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of its processes are killed after a commit, which is done again if it was lost."""
    url = careless.database(f"rehyb_{durability}")
    upgrade(url)
    worker = Worker(url, durability)
    study, _ = studies.create(worker.engine, records.plan(rows=20), key=None, digest="", now=0.0)
    server_has_written_all(worker.engine)
    cuts, lost, left = 0, 0, True
    # In turn: a lease, then results and the next lease in one turn; results by themselves.
    while left and (CUTS > 1 or cuts < BOUNDARIES):
        before = worker.state
        left = worker.step(study)
        _, held, acknowledged = worker.state
        killed = careless.pid
        careless.crash()
        cuts += 1
        # What counts a server's processor time by it counts the new one's.
        assert careless.pid != killed
        worker.reconnect()
        assert check.faults(worker.engine) == []
        results = studies.get(worker.engine, study.id).result_count
        with reading(worker.engine) as connection:
            stored = held is None or leases.find(connection, held.lease.id) is not None
        if results < acknowledged or not stored:
            lost += 1
            worker.state = before
            left = worker.step(study)
        server_has_written_all(worker.engine)
    worker.close()
    with capsys.disabled():
        print(f"\nPostgreSQL, {durability}: killed after {cuts} commits, {lost} of them lost")
    assert left == (CUTS == 1)
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
