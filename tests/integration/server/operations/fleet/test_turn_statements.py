"""What a turn asks PostgreSQL: in few trips, by statements planned once, by way of indexes."""

from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy.engine import Engine

from server.operations.fleet import leases
from server.operations.fleet.exchange import Exchange, Grant, Post
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
    exchange = Exchange(now=0.0, ttl=TTL, posted=post)
    assert exchange.study == ""
    ((judgements, found),) = turns.take(exchange.study, lambda: [exchange]).answers
    assert [judgement.verdict for judgement in judgements] == ["unknown"] and found is None


def test_no_turn_reads_the_instances_of_other_rows_although_nothing_is_known_of_the_table(
    turns: Turns,
) -> None:
    for statement, values in (
        (sql.MOVE, ("done", [(1, 1, None)], "s")),
        (sql.IN_ROWS, ([1], "s")),
        (sql.EMPTY, ("done", "s", 1, 2, ["l"])),
    ):
        ((text, given),) = statement.words("postgresql", *values)
        plan = [line for (line,) in turns.ask("EXPLAIN " + text, given)]
        looks = [line for line in plan if "Index Cond" in line or "Seq Scan" in line]
        assert looks and all('"row"' in line for line in looks), plan


def test_no_turn_looks_through_all_leases_that_are_open(turns: Turns) -> None:
    for statement, values in ((sql.END, ("finished",)), (sql.EXTEND, (9.0, "open", 1.0))):
        ((text, given),) = statement.words("postgresql", *values[:1], "open", *values[2:], ["l"])
        turns.ask(text, given)
        ((name,),) = turns.ask(
            "SELECT name FROM pg_prepared_statements WHERE position(%s in statement) = 1",
            [text.partition("%s")[0].strip()],
        )
        told = ", ".join(f"'{value}'" for value in given)
        plan = [line for (line,) in turns.ask(f"EXPLAIN EXECUTE {name}({told})", ())]
        assert any("leases_id_key" in line for line in plan), plan


def test_a_statement_of_a_turn_is_planned_once(turns: Turns) -> None:
    for _ in range(3):
        turns.ask(*sql.END.words("postgresql", "finished", "open", ["l"])[0])
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


def test_a_worker_that_finds_nothing_to_do_costs_two_trips(
    turns: Turns, monkeypatch: pytest.MonkeyPatch
) -> None:
    trips: list[list[str]] = []
    trip = Pipeline.trip

    async def counted(self: Pipeline, statements: Any) -> Any:
        trips.append([text.split()[0] for text, _ in statements])
        return await trip(self, statements)

    monkeypatch.setattr(Pipeline, "trip", counted)
    asked = Exchange(now=0.0, ttl=TTL, request=asking("w", 4))
    assert turns.take("", lambda: [asked]).answers == [([], None)]
    # What there is to do, and second opinions that are wanted; the worker was heard from.
    assert trips == [["BEGIN", "SELECT", "SELECT"], ["INSERT", "COMMIT"]]
