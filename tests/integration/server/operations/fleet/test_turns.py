"""A turn serves many workers as transactions of their own would have, one after the other."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any
from uuid import UUID

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.operations import check
from server.operations.fleet import leases
from server.operations.fleet.exchange import (
    Answer,
    Deferred,
    Exchange,
    Grant,
    Served,
)
from server.operations.fleet.turns import serve_within, take_turn
from server.operations.study import studies
from server.records import Plan
from server.states import StudyState
from server.store import create_engine
from server.store.database.engine import reading, writing
from server.store.database.schema import comparisons, instances, results, workers
from server.store.database.schema import leases as lease_table
from server.store.database.schema import studies as study_table
from server.store.fleet.turns import _SETTINGS, at_once, turn_within
from tests.testbed.coordinators.exchanges import asking, posting
from tests.testbed.coordinators.turns import Turns

TTL = 60.0


class Twin:
    """One of two coordinators' databases, and what its workers hold."""

    def __init__(self, engine: Engine, turns: Turns | None) -> None:
        self.engine = engine
        self.turns = turns
        self.held: dict[str, Grant] = {}

    def served(self, exchanges: list[Exchange], study: str) -> list[Served]:
        """Serve all in a turn, or each in one of its own."""
        if self.turns is None:
            return [self.alone(one) for one in exchanges]
        if self.engine.dialect.name == "sqlite":
            with writing(self.engine) as connection:
                turn = take_turn(turn_within(connection), study, lambda: exchanges)
                return [*at_once(turn).answers]
        return [*self.turns.take(study, lambda: exchanges).answers]

    def alone(self, exchange: Exchange) -> Served:
        with writing(self.engine) as connection:
            (answer,) = serve_within(connection, [exchange])
            return answer

    def finished(self, answer: Served) -> Answer:
        """Return an answer with what the turns of other studies have to add."""
        judgements, found = answer
        while isinstance(found, Deferred):
            ((more, found),) = self.served([found.rest], found.rest.study)
            judgements = judgements + more
        return judgements, found

    def tables(self) -> dict[str, Any]:
        """Return what is stored, but for ids that chance made."""
        with reading(self.engine) as connection:

            def of(table: sa.Table, *names: str, **renamed: sa.ColumnElement[Any]) -> Any:
                columns = [*(table.c[name] for name in names), *renamed.values()]
                return sorted(map(repr, connection.execute(sa.select(*columns)).all()))

            held = instances.c.lease_id.is_not(None)
            place = ("study_id", "row", "position")
            counts = ("handed_out", "leased", "result_count", "ok_count", "rows_complete")
            return {
                "studies": of(study_table, "id", "state", *counts, "failures", "identity"),
                "instances": of(instances, *place, "state", "attempts", "host_class", held=held),
                "results": of(results, *place, "seq", "outcome", "outputs", "worker_id"),
                "leases": of(lease_table, "worker_id", "state", "instances", "expires_at"),
                "workers": of(workers, "id", "host", "last_seen", "instances_done", "host_class"),
                "comparisons": of(comparisons, *place, "state", "first_host"),
            }


@pytest.fixture
def kind() -> str:
    return "postgresql"


@pytest.fixture
def twins(engine: Engine, turns: Turns, upgraded_file: Path, tmp_path: Path) -> list[Twin]:
    """The same coordinator in turns, and on SQLite, one by one."""
    file = tmp_path / "twin.sqlite3"
    file.write_bytes(upgraded_file.read_bytes())
    return [Twin(engine, turns), Twin(create_engine(f"sqlite:///{file}"), None)]


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
@pytest.mark.parametrize("seed", range(4))
def test_a_turn_stores_and_answers_what_single_transactions_do(
    twins: list[Twin], plan: Callable[..., Plan], seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = Random(seed)
    ids = []
    for number, rows in enumerate((9, 6)):
        called = UUID(int=(number + 1) << 100)
        monkeypatch.setattr("server.operations.study.studies.uuid4", lambda called=called: called)
        drawn = plan(rows=rows, seed=number)
        for twin in twins:
            study, _ = studies.create(twin.engine, drawn, key=None, digest="", now=float(number))
        ids.append(study.id)
    kinds: list[dict[str, str]] = [{}, {}, {"numpy": "3"}]
    for step in range(40):
        now = float(step)
        if rng.random() < 0.1:
            state = rng.choice([StudyState.DRAINING, StudyState.RUNNING])
            for twin in twins:
                if not studies.get(twin.engine, ids[0]).state.has_ended:
                    studies.switch(twin.engine, ids[0], state)
        asked: list[tuple[str, int, list[tuple[int, dict[str, Any]]], dict[str, Any], bool]] = []
        company = rng.sample(range(6), rng.randint(1, 4))
        for worker in company:
            how = _reports(rng, twins[0].held.get(f"w{worker}"))
            said: dict[str, Any] = {"fence": 0} if rng.random() < 0.05 else {}
            # Second opinions that are asked for in a turn are handed out from the next one on.
            said["share"] = 0.2 if len(company) == 1 else 0.0
            asked.append((f"w{worker}", rng.randint(1, 7), how, said, rng.random() < 0.9))
        outcomes = []
        later: dict[int, Exchange] = {}
        for twin in twins:
            exchanges = []
            for worker, most, how, said, wants in asked:
                held = twin.held.get(worker)
                posted = posting(held, how, **said) if held is not None and how else None
                versions = kinds[int(worker[1:]) % 3]
                host = f"h{int(worker[1:]) % 2}"
                request = asking(worker, most, host=host, versions=versions)
                exchanges.append(
                    Exchange(now=now, ttl=TTL, posted=posted, request=request)
                    if wants or posted is None
                    else Exchange(now=now, ttl=TTL, posted=posted)
                )
            if twin.turns is not None:
                served = twin.served(exchanges, ids[0])
                later = {n: a[1].rest for n, a in enumerate(served) if isinstance(a[1], Deferred)}
            else:
                served = [
                    twin.alone(one) if n not in later else _before(twin, one, later[n])
                    for n, one in enumerate(exchanges)
                ]
            answers = [twin.finished(answer) for answer in served]
            for one, (_, found) in zip(exchanges, answers, strict=True):
                if isinstance(found, Grant) and one.request is not None:
                    twin.held[one.request.worker.id] = found
            outcomes.append([_told(answer, ids) for answer in answers])
        assert outcomes[0] == outcomes[1], (seed, step)
        assert twins[0].tables() == twins[1].tables(), (seed, step)
    for twin in twins:
        assert check.faults(twin.engine) == []


def _before(twin: Twin, exchange: Exchange, later: Exchange) -> Served:
    """Serve what of an exchange was served before the rest was left to another turn."""
    if later.posted is not None:
        return [], Deferred(rest=exchange)
    # What the study had nothing for then it may have something for when others have come and gone.
    if exchange.posted is None:
        return [], Deferred(rest=later)
    judgements, _ = twin.alone(replace(exchange, request=None))
    return judgements, Deferred(rest=later)


def _reports(rng: Random, held: Grant | None) -> list[tuple[int, dict[str, Any]]]:
    """Return results of some of a lease's instances: most of them good."""
    if held is None:
        return []
    count = len(held.lease.instances)
    chosen = range(count) if rng.random() < 0.7 else rng.sample(range(count), rng.randint(1, count))
    odd = [{"outcome": "crashed", "outputs": None}, {"outputs": {}}, {"outcome": "slipped"}]
    return [(n, rng.choice(odd) if rng.random() < 0.05 else {}) for n in chosen]


def _told(answer: Answer, ids: list[str]) -> Any:
    judgements, found = answer
    said = [(j.about, j.verdict, j.detail) for j in judgements]
    if isinstance(found, Grant):
        return said, ids.index(found.study.id), found.lease.instances, found.lease.compares
    return said, type(found).__name__


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_what_is_unusual_is_served_in_the_midst_of_a_turn(
    twins: list[Twin], plan: Callable[..., Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.operations.study.studies.uuid4", lambda: UUID(int=1 << 100))
    told, tables = [], []
    for twin in twins:
        study, _ = studies.create(twin.engine, plan(), key=None, digest="", now=0.0)
        ((_, grant),) = twin.served([Exchange(now=0.0, ttl=TTL, request=asking("w", 6))], study.id)
        assert isinstance(grant, Grant)
        odd = [
            posting(grant, [(0, {"outcome": "crashed", "outputs": None})]),
            posting(grant, [(1, {"outputs": {"y": float("nan")}})]),
            posting(grant, [(2, {})], fence=99),
            posting(grant, [(2, {}), (2, {}), (2, {"outputs": {"y": 7.0}})]),
            posting(grant, [(2, {}), (2, {"outputs": {"y": 7.0}})]),
            posting(grant, [(3, {})], lease="no such lease"),
            posting(grant, [(3, {"outcome": "slipped", "state": {"x": ["\0"]}})]),
        ]
        waiting = [Exchange(now=1.0, ttl=TTL, posted=post) for post in odd]
        # Who asks in the same turn gets what has just come back.
        waiting += [Exchange(now=1.0, ttl=TTL, request=asking("v", 1, host="h2"))] * 2
        answers = twin.served(waiting, study.id)
        told.append([_told(answer, [study.id]) for answer in answers])
        tables.append(twin.tables())
    assert [[verdict for _, verdict, _ in said] for said, *_ in told[0][:7]] == [
        ["accepted"],
        ["invalid"],
        ["invalid"],
        ["accepted", "duplicate", "conflict"],
        ["duplicate", "conflict"],
        ["unknown"],
        ["accepted"],
    ]
    assert [places for _, _, places, _ in told[0][7:]] == [((0, 0),), ((0, 1),)]
    assert told[0] == told[1] and tables[0] == tables[1]


def test_a_late_result_is_not_given_out_again_in_the_same_turn(
    engine: Engine, turns: Turns, plan: Callable[..., Plan]
) -> None:
    study, _ = studies.create(engine, plan(rows=1), key=None, digest="", now=0.0)
    asked = Exchange(now=0.0, ttl=TTL, request=asking("w", 4))
    (answer,) = turns.take(study.id, lambda: [asked]).answers
    assert isinstance(answer[1], Grant)
    leases.reap(engine, now=100.0, ttl=TTL)
    late = Exchange(now=101.0, ttl=TTL, posted=posting(answer[1], [(n, {}) for n in range(4)]))
    other = Exchange(now=101.0, ttl=TTL, request=asking("v", 4))
    (said, _), (_, found) = turns.take(study.id, lambda: [late, other]).answers
    assert {judgement.verdict for judgement in said} == {"accepted"} and found is None
    assert studies.get(engine, study.id).state == "complete"


def test_a_turn_whose_connection_is_lost_stores_nothing_and_the_next_one_has_another(
    engine: Engine, turns: Turns, plan: Callable[..., Plan]
) -> None:
    study, _ = studies.create(engine, plan(), key=None, digest="", now=0.0)
    before = Twin(engine, None).tables()

    def cut() -> list[Exchange]:
        with writing(engine) as connection:
            connection.execute(
                sa.text(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                    "WHERE datname = current_database() AND state = 'idle in transaction' "
                    "AND pid <> pg_backend_pid()"
                )
            )
        return [Exchange(now=0.0, ttl=TTL, request=asking("w", 4))]

    with pytest.raises(Exception, match=r"terminating connection|closed"):
        turns.take(study.id, cut)
    assert Twin(engine, None).tables() == before
    asked = Exchange(now=0.0, ttl=TTL, request=asking("w", 4))
    (answer,) = turns.take(study.id, lambda: [asked]).answers
    assert isinstance(answer[1], Grant)


def test_a_coordinator_that_stops_in_mid_turn_keeps_its_study_from_nobody(
    engine: Engine, turns: Turns, plan: Callable[..., Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "idle_in_transaction_session_timeout"
    assert 0 < int(_SETTINGS[name]) <= 15_000, "others wait so long, 0 is for ever"
    monkeypatch.setitem(_SETTINGS, name, "100")
    study, _ = studies.create(engine, plan(), key=None, digest="", now=0.0)
    others: list[Served] = []

    def stopped() -> list[Exchange]:
        # The event loop stands still here, with the study locked.
        with writing(engine) as connection:
            connection.execute(sa.text("SET LOCAL lock_timeout = '10s'"))
            theirs = Exchange(now=0.0, ttl=TTL, request=asking("other", 4))
            others.extend(serve_within(connection, [theirs]))
        return [Exchange(now=0.0, ttl=TTL, request=asking("w", 4))]

    with pytest.raises(Exception, match="idle-in-transaction"):
        turns.take(study.id, stopped)
    ((_, theirs),) = others
    assert isinstance(theirs, Grant)
    # What it goes on with when it wakes up is what the others have left.
    asked = Exchange(now=0.0, ttl=TTL, request=asking("w", 4))
    (answer,) = turns.take(study.id, lambda: [asked]).answers
    assert isinstance(answer[1], Grant)
    assert not {*answer[1].lease.instances} & {*theirs.lease.instances}
