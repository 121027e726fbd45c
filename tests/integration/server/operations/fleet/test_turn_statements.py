"""What a turn asks PostgreSQL: in few trips, by statements planned once, by way of indexes."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy.engine import Engine

from server.logic.study.points import told
from server.operations.fleet import exchange, leases
from server.operations.fleet.exchange import Exchange, Grant, Post
from server.operations.fleet.exchanges import Exchanges
from server.operations.study import studies
from server.records import Plan
from server.store.database.pipeline import Pipeline
from server.store.fleet import turn_statements as sql
from server.store.fleet.turns import AFRESH
from tests.testbed.coordinators.exchanges import asking
from tests.testbed.coordinators.records import report
from tests.testbed.coordinators.turns import Turns

TTL = 60.0


@pytest.fixture
def kind() -> str:
    return "postgresql"


def test_an_instance_of_any_name_disturbs_no_turn(
    engine: Engine, turns: Turns, plan: Callable[..., Plan]
) -> None:
    post = Post(reports=[report("\0 ' or 1:0:0")], lease="l", fence=1, worker="w")
    posted = Exchange(now=0.0, ttl=TTL, posted=post)
    assert posted.study == ""
    ((judgements, found),) = turns.take(posted.study, lambda: [posted]).answers
    assert [judgement.verdict for judgement in judgements] == ["unknown"] and found is None


def test_no_turn_reads_the_instances_of_other_rows_although_nothing_is_known_of_the_table(
    engine: Engine, turns: Turns
) -> None:
    for statement, values in (
        (sql.MOVE, ("done", [(1, 1, None)], "s")),
        (sql.IN_ROWS, ([1], "s")),
        (sql.EMPTY, ("done", "s", 1, 2, ["l"])),
    ):
        ((text, given),) = statement.statements(engine.dialect, *values)
        plan = [line for (line,) in turns.ask("EXPLAIN " + text, given)]
        looks = [line for line in plan if "Index Cond" in line or "Seq Scan" in line]
        assert looks and all('"row"' in line for line in looks), plan


def test_no_turn_looks_through_all_leases_that_are_open(engine: Engine, turns: Turns) -> None:
    for statement, values in ((sql.END, ("finished",)), (sql.EXTEND, (9.0, "open", 1.0))):
        ((text, given),) = statement.statements(
            engine.dialect, *values[:1], "open", *values[2:], ["l"]
        )
        turns.ask(text, given)
        ((name,),) = turns.ask(
            "SELECT name FROM pg_prepared_statements WHERE position(%s in statement) = 1",
            [text.partition("%s")[0].strip()],
        )
        told = ", ".join(f"'{value}'" for value in given)
        plan = [line for (line,) in turns.ask(f"EXPLAIN EXECUTE {name}({told})", ())]
        assert any("leases_id_key" in line for line in plan), plan


def test_a_statement_of_a_turn_is_planned_once(engine: Engine, turns: Turns) -> None:
    for _ in range(3):
        turns.ask(*sql.END.statements(engine.dialect, "finished", "open", ["l"])[0])
    # The connection may have been used for something else before.
    counted = (
        "SELECT sum(custom_plans)::int, max(generic_plans)::int FROM pg_prepared_statements "
        "WHERE starts_with(name, 'trip_')"
    )
    ((each_time, again),) = turns.ask(counted, ())
    assert each_time == 0
    assert again >= 3


def test_an_instance_that_came_back_is_passed_over_by_few_turns(
    engine: Engine, turns: Turns, plan: Callable[..., Plan]
) -> None:
    study, _ = studies.create(engine, plan(rows=60), key=None, digest="", now=0.0)

    def lease(worker: str, most: int) -> Grant:
        asked = Exchange(now=0.0, ttl=TTL, request=asking(worker, most))
        ((_, found),) = turns.take(study.id, lambda: [asked]).answers
        assert isinstance(found, Grant)
        return found

    def give_back(held: Grant) -> None:
        leases.release(engine, held.lease.id, fence=held.lease.fence, now=0.0)

    early = lease("early", 4)
    give_back(lease("late", 200))
    given = [lease("w", 1).lease.instances[0] for _ in range(2)]
    assert given == [(1, 0), (1, 1)]
    give_back(early)
    given += [lease("w", 1).lease.instances[0] for _ in range(AFRESH)]
    assert (0, 0) in given


@pytest.fixture
def trips(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return where trips are written down, each when it has come back: how statements begin."""
    made: list[list[str]] = []
    trip = Pipeline.trip

    async def counted(self: Pipeline, statements: Any) -> Any:
        found = await trip(self, statements)
        made.append([text.split()[0] for text, _ in statements])
        return found

    monkeypatch.setattr(Pipeline, "trip", counted)
    return made


def test_who_wants_more_than_waits_costs_no_further_trip(
    engine: Engine, turns: Turns, plan: Callable[..., Plan], trips: list[list[str]]
) -> None:
    study, _ = studies.create(engine, plan(rows=9), key=None, digest="", now=0.0)
    width, places = study.plan.width, []
    # After the second it is known that those before the second row have gone.
    for wanted in (width + 1, 1, width):
        trips.clear()
        asked = Exchange(now=0.0, ttl=TTL, request=asking("w", wanted))
        ((_, found),) = turns.take(study.id, lambda asked=asked: [asked]).answers
        assert isinstance(found, Grant)
        places += found.lease.instances
    assert places == [divmod(number, width) for number in range(2 * width + 2)]
    assert len(trips) == 3


def test_points_of_a_lease_are_made_while_the_server_writes_it(
    engine: Engine,
    plan: Callable[..., Plan],
    trips: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study, _ = studies.create(engine, plan(rows=1), key=None, digest="", now=0.0)
    made_after: list[int] = []

    def making(*given: Any) -> Any:
        made_after.append(len(trips))
        return told(*given)

    monkeypatch.setattr(exchange, "told", making)

    async def asked() -> Any:
        exchanges = Exchanges(engine)
        request = asking("w", 2)
        _, found = await exchanges(Exchange(now=0.0, ttl=TTL, request=request, first=study.id))
        await exchanges.close()
        return found

    found = asyncio.run(asked())
    assert found.lease.fence > 0
    assert found.instances() == told(study, found.lease.instances)
    # To lock, to look, to write.
    assert len(trips) == 3 and made_after == [2]


def test_a_worker_that_finds_nothing_to_do_costs_two_trips(
    turns: Turns, trips: list[list[str]]
) -> None:
    asked = Exchange(now=0.0, ttl=TTL, request=asking("w", 4))
    assert turns.take("", lambda: [asked]).answers == [([], None)]
    # What there is to do, and second opinions that are wanted; the worker was heard from.
    assert trips == [["BEGIN", "SELECT", "SELECT"], ["INSERT", "COMMIT"]]
