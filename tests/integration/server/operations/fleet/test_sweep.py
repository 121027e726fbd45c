"""Silence of workers counts while somebody is there to hear them."""

import resource
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import DBAPIError, OperationalError

from server.clocks import Forward
from server.operations.fleet import leases
from server.operations.fleet import sweep as module
from server.operations.fleet.sweep import SWEEP_SECONDS, Sweep
from server.operations.study import studies
from server.records import Plan
from server.store import create_engine, upgrade
from server.store.database import files
from server.store.database.engine import writing
from server.store.database.presence import is_away
from tests.testbed.coordinators import exchanges

Drawing = Callable[..., Plan]

TTL = 60.0


class Ticks:
    """Seconds that pass as they are told to."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def ticks() -> Ticks:
    return Ticks()


@pytest.fixture
def sweep(engine: Engine, plan: Drawing, ticks: Ticks) -> Sweep:
    """What looks after leases, of which one holds three instances of a study."""
    studies.create(engine, plan(), key=None, digest="", now=0.0)
    held(engine)
    return Sweep(engine, ticks, TTL, ticks)


def held(engine: Engine) -> Any:
    asked = {"models": ["ishigami"], "host": "h", "versions": {}}
    return exchanges.grant(engine, worker="w", max_instances=3, now=0.0, ttl=TTL, **asked)


def quarters(sweep: Sweep, ticks: Ticks, until: float) -> list[int]:
    """Return how many instances come back at each quarter of a lease."""
    found = []
    while ticks.now < until:
        ticks.now += TTL / 4.0
        found.append(sweep())
    return found


def test_a_worker_that_falls_silent_while_all_is_well_loses_its_lease(
    sweep: Sweep, ticks: Ticks
) -> None:
    assert quarters(sweep, ticks, TTL) == [0, 0, 0, 3]


@pytest.mark.parametrize("away", [TTL / 2.0 + 1.0, TTL, 100.0 * TTL])
def test_silence_while_a_coordinator_stood_still_is_no_worker_s(
    sweep: Sweep, ticks: Ticks, away: float
) -> None:
    assert quarters(sweep, ticks, TTL / 2.0) == [0, 0]
    ticks.now += away
    assert sweep() == 0
    # What is silent from now on is lost.
    assert quarters(sweep, ticks, ticks.now + TTL) == [0, 0, 0, 3]


def test_who_renews_first_after_an_absence_keeps_its_lease(
    engine: Engine, sweep: Sweep, ticks: Ticks
) -> None:
    other = held(engine).lease
    ticks.now += 2.0 * TTL
    sweep.catch_up()
    until = leases.renew(engine, other.id, fence=other.fence, now=ticks.now, ttl=TTL)
    assert until == 3.0 * TTL


def test_silence_while_the_database_was_away_is_no_worker_s(
    engine: Engine, sweep: Sweep, ticks: Ticks, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: Any, **__: Any) -> int:
        raise OperationalError("BEGIN", {}, Exception("it is away"))

    with monkeypatch.context() as patch:
        patch.setattr(leases, "reap", away)
        patch.setattr(leases, "extend_open_leases", away)
        for _ in range(3):
            ticks.now += TTL / 2.0
            with pytest.raises(OperationalError):
                sweep()
    ticks.now += TTL
    assert sweep() == 0
    (study,) = studies.every(engine)
    assert (study.leased, study.failures) == (3, {})


@contextmanager
def full_disk(engine: Engine) -> Iterator[None]:
    """No file of this process can grow beyond the log of SQLite until the block ends."""
    log = Path(f"{engine.url.database}-wal")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (log.stat().st_size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("kind", ["sqlite"])
def test_silence_while_the_disk_was_full_is_no_worker_s(
    engine: Engine, sweep: Sweep, ticks: Ticks
) -> None:
    lease = held(engine).lease

    def renew() -> float:
        sweep.catch_up()
        return leases.renew(engine, lease.id, fence=lease.fence, now=ticks.now, ttl=TTL)

    with full_disk(engine):
        for _ in range(6):
            ticks.now += TTL / 4.0
            with pytest.raises(DBAPIError) as failed:
                sweep()
            assert is_away(failed.value)
            with pytest.raises(DBAPIError) as failed:
                renew()
            assert is_away(failed.value)
    assert renew() == ticks.now + TTL
    assert sweep() == 0


def test_a_short_delay_of_a_short_lease_is_no_absence(
    engine: Engine, sweep: Sweep, ticks: Ticks
) -> None:
    short = Sweep(engine, lambda: ticks.now + TTL, 0.5, ticks)
    ticks.now = 0.9
    assert short() == 3


def test_however_many_ask_it_is_looked_once_a_while(sweep: Sweep, ticks: Ticks) -> None:
    ticks.now = 5.0
    assert sweep.is_due()
    sweep()
    found = []
    for moment in (5.0 + SWEEP_SECONDS / 2.0, 5.0 + SWEEP_SECONDS, 4.0):
        ticks.now = moment
        found.append(sweep.is_due())
    # The last by a clock that was set back.
    assert found == [False, True, True]


def test_silence_while_somebody_kept_the_database_is_no_worker_s(
    engine: Engine, sweep: Sweep, ticks: Ticks, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def waited(engine: Engine) -> Iterator[Connection]:
        ticks.now += 2.0 * TTL
        with writing(engine) as connection:
            yield connection

    ticks.now = TTL / 4.0
    monkeypatch.setattr(module, "writing", waited)
    assert sweep() == 0


def test_a_renewal_that_had_to_wait_shortens_no_lease(engine: Engine, sweep: Sweep) -> None:
    other = held(engine).lease
    leases.extend_open_leases(engine, now=30.0, ttl=TTL)
    until = leases.renew(engine, other.id, fence=other.fence, now=10.0, ttl=TTL)
    assert until == 30.0 + TTL


def test_a_file_that_another_process_keeps_to_itself_fails_as_a_database_that_is_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "BUSY_SECONDS", 0)
    url = f"sqlite:///{tmp_path}/used.sqlite3"
    upgrade(url)
    engine = create_engine(url)
    other = sqlite3.connect(tmp_path / "used.sqlite3", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(OperationalError) as failed, writing(engine):
        pass
    assert is_away(failed.value)
    other.close()
    engine.dispose()


@pytest.mark.parametrize("ahead", [3.0 * TTL, 3600.0])
def test_a_coordinator_whose_clock_is_behind_another_s_loses_no_lease_to_it(
    engine: Engine, plan: Drawing, ticks: Ticks, ahead: float
) -> None:
    studies.create(engine, plan(), key=None, digest="", now=0.0)
    clock = Forward(ticks)
    behind = Sweep(engine, clock, TTL, ticks, follow=clock.follow)
    mine = held(engine).lease
    asked = {"models": ["ishigami"], "host": "other", "versions": {}}
    exchanges.grant(engine, worker="v", max_instances=1, now=ahead, ttl=TTL, **asked)
    assert behind() == 0
    assert clock() == ahead
    assert leases.reap(engine, now=ahead + TTL / 2.0, ttl=TTL) == 0
    assert leases.renew(engine, mine.id, fence=mine.fence, now=clock(), ttl=TTL) == ahead + TTL


def test_clocks_that_differ_by_next_to_nothing_prolong_no_lease(
    engine: Engine, plan: Drawing, ticks: Ticks
) -> None:
    studies.create(engine, plan(), key=None, digest="", now=0.0)
    clock = Forward(ticks)
    behind = Sweep(engine, clock, TTL, ticks, follow=clock.follow)
    held(engine)
    for _ in range(4):
        ticks.now += TTL / 4.0
        asked = {"models": ["sobol_g"], "host": "other", "versions": {}}
        now = ticks.now + 0.5
        exchanges.grant(engine, worker="v", max_instances=1, now=now, ttl=TTL, **asked)
        lost = behind()
    assert lost == 3
