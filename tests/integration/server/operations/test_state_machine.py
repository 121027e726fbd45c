"""Whatever workers, operators and the clock do, in whatever order, the database stays whole."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from math import inf
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy.engine import Engine

from server.errors import ConflictError
from server.logic.fleet.verdicts import Report
from server.logic.study.plans import draw_up, instance_id
from server.operations import check
from server.operations.fleet import comparisons, leases, results
from server.operations.fleet.leasing import Grant, LeaseRequest
from server.operations.study import reruns, studies
from server.records import Introduction
from server.states import StudyState
from server.store import create_engine, upgrade
from server.store.database.engine import writing
from server.store.database.schema import metadata
from sim.models import ISHIGAMI
from tests.testbed.coordinators import exchanges

TTL = 60.0
#: Two kinds of machines, the first with two hosts.
HOSTS = {"a": {"platform": "Linux"}, "b": {"platform": "Linux"}, "c": {"platform": "Darwin"}}
SAID: dict[str, dict[str, Any]] = {
    "ok": {},
    "other": {"outputs": {"y": 2.5}},
    "nonsense": {"outputs": {"y": inf}},
    "diverged": {"outcome": "diverged", "outputs": {}},
    "crashed": {"outcome": "crashed", "outputs": {}},
    "timed_out": {"outcome": "timed_out", "outputs": {}},
}
WORDS = st.sampled_from(["ok", "ok", "ok", *SAID])


class Queue(RuleBasedStateMachine):
    """One coordinator's store, its workers and its operator."""

    def __init__(self, engine: Engine) -> None:
        super().__init__()
        self.engine = engine
        self.now = 0.0
        self.grants: list[Grant] = []
        #: Outcomes of final results, which only a re-run may take back.
        self.filled: dict[tuple[str, int, int], str] = {}
        self.names = count()
        with writing(engine) as connection:
            for table in reversed(metadata.sorted_tables):
                connection.execute(sa.delete(table))

    @initialize()
    def begin(self) -> None:
        self.study = self._submit(rows=2)
        self.other = self._submit(rows=1)

    def _submit(self, rows: int) -> str:
        plan = draw_up(
            name=f"study {next(self.names)}",
            model=ISHIGAMI,
            called=ISHIGAMI.name,
            method="morris",
            sampling="sobol",
            rows=rows,
            seed=1,
            factors=None,
            fixed={},
            outputs=None,
        )
        return studies.create(self.engine, plan, key=None, digest="", now=self.now)[0].id

    def _lease(self, host: str, n: int) -> Grant | None:
        asked = {"models": ["ishigami"], "versions": HOSTS[host], "worker": f"of-{host}"}
        return exchanges.grant(
            self.engine,
            host=host,
            max_instances=n,
            now=self.now,
            ttl=TTL,
            **asked,  # type: ignore[arg-type]
        )

    def _said(self, grant: Grant, words: str) -> results.Post:
        held = grant.lease
        said = {"outcome": "ok", "outputs": {"y": 1.5}, **SAID[words]}
        reports = [
            Report(
                instance=instance_id(held.study, *place),
                reason="",
                state=None,
                wall_seconds=0.1,
                **said,
            )
            for place in held.instances
        ]
        return results.Post(
            reports=reports,
            lease=held.id,
            fence=held.fence,
            worker=held.worker,
            share=0.5,
            tolerance=1e-3,
        )

    def _post(self, grant: Grant, words: str) -> None:
        with writing(self.engine) as connection:
            results.take(connection, self._said(grant, words), now=self.now, ttl=TTL)

    @rule(host=st.sampled_from(list(HOSTS)), n=st.integers(1, 6))
    def lease(self, host: str, n: int) -> None:
        leases.reap(self.engine, now=self.now)
        if grant := self._lease(host, n):
            self.grants.append(grant)

    @precondition(lambda self: self.grants)
    @rule(number=st.integers(0, 9), words=WORDS)
    def post(self, number: int, words: str) -> None:
        self._post(self.grants[-1 - number % len(self.grants)], words)

    @precondition(lambda self: self.grants)
    @rule(
        number=st.integers(0, 9),
        words=WORDS,
        host=st.sampled_from(list(HOSTS)),
        n=st.integers(1, 6),
    )
    def post_and_lease(self, number: int, words: str, host: str, n: int) -> None:
        said = self._said(self.grants[-1 - number % len(self.grants)], words)
        request = LeaseRequest(
            worker=Introduction(id=f"of-{host}", host=host, versions=HOSTS[host]),
            models=["ishigami"],
            max_instances=n,
        )
        with writing(self.engine) as connection:
            _, found = results.exchange(connection, said, request, now=self.now, ttl=TTL)
        if isinstance(found, Grant):
            self.grants.append(found)

    @precondition(lambda self: self.grants)
    @rule(number=st.integers(0, 9))
    def release(self, number: int) -> None:
        held = self.grants[-1 - number % len(self.grants)].lease
        with suppress(ConflictError):
            leases.release(self.engine, held.id, fence=held.fence, now=self.now)

    @precondition(lambda self: self.grants)
    @rule(number=st.integers(0, 9))
    def renew(self, number: int) -> None:
        held = self.grants[-1 - number % len(self.grants)].lease
        with suppress(ConflictError):
            leases.renew(self.engine, held.id, fence=held.fence, now=self.now, ttl=TTL)

    @rule(seconds=st.sampled_from([10.0, 45.0, TTL]))
    def wait(self, seconds: float) -> None:
        self.now += seconds

    @rule(back=st.booleans())
    def restart_with_the_clock_an_hour_off(self, back: bool) -> None:
        self.now += -3600.0 if back else 3600.0
        leases.extend_open_leases(self.engine, now=self.now, ttl=TTL)

    @rule(state=st.sampled_from([StudyState.PAUSED, StudyState.DRAINING, StudyState.RUNNING]))
    def control(self, state: StudyState) -> None:
        with suppress(ConflictError):
            studies.switch(self.engine, self.study, state)

    @rule(rows=st.integers(2, 4))
    def extend(self, rows: int) -> None:
        with suppress(ConflictError):
            studies.extend(self.engine, self.study, rows)

    @rule(which=st.sampled_from(["failed", "all"]))
    def rerun(self, which: str) -> None:
        with suppress(ConflictError):
            reruns.rerun(self.engine, self.study, which=which, outcomes=None, now=self.now)
            self.filled = {k: v for k, v in self.filled.items() if k[0] != self.study}

    @rule()
    def give_up_on_machines_that_are_gone(self) -> None:
        if reruns.free_stranded_rows(self.engine, now=self.now, patience=100.0):
            self.filled = {}
        comparisons.give_up(self.engine, now=self.now, patience=100.0)

    @invariant()
    def is_whole(self) -> None:
        assert check.faults(self.engine) == []
        stored = {
            (study.id, result.row, result.position): result.outcome
            for study in studies.every(self.engine)
            for result, _ in results.in_order(self.engine, study)
        }
        assert self.filled.items() <= stored.items(), "a final result was changed"
        self.filled = stored

    def teardown(self) -> None:
        """Whatever has happened, one diligent machine of each kind brings both to their end."""
        for study in (self.study, self.other):
            with suppress(ConflictError):
                studies.switch(self.engine, study, StudyState.RUNNING)
        for _ in range(6):
            self.now += TTL
            leases.reap(self.engine, now=self.now)
            for host in HOSTS:
                while grant := self._lease(host, 8):
                    self._post(grant, "ok")
        self.is_whole()
        for study in studies.every(self.engine):
            assert study.state == "complete"
            assert study.result_count == study.plan.instances


@pytest.fixture(scope="module")
def engine_of(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Any]:
    """Opens an empty database of one kind or the other."""

    @contextmanager
    def opened(kind: str) -> Iterator[Engine]:
        if kind == "sqlite":
            folder: Path = tmp_path_factory.mktemp("machine")
            url = f"sqlite:///{folder}/rehyb.sqlite3"
        else:
            url = request.getfixturevalue("empty_database")()
        upgrade(url)
        engine = create_engine(url)
        yield engine
        engine.dispose()

    return opened


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_nothing_is_lost_or_counted_twice(engine_of: Callable[[str], Any], kind: str) -> None:
    with engine_of(kind) as engine:
        run_state_machine_as_test(  # type: ignore[no-untyped-call]
            lambda: Queue(engine),
            settings=settings(
                max_examples=15,
                stateful_step_count=25,
                deadline=None,
                suppress_health_check=list(HealthCheck),
            ),
        )
