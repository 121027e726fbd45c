"""Statements that go to PostgreSQL together, from an event loop."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import psycopg
import pytest
from sqlalchemy.engine import Engine

from server.store.database.pipeline import Pipeline

Work = Callable[[Pipeline], Awaitable[Any]]


@pytest.fixture
def kind() -> str:
    return "postgresql"


@pytest.fixture
def with_pipeline(engine: Engine) -> Iterator[Callable[[Work], Any]]:
    """What does some work with a pipeline of its own."""
    held = engine.raw_connection()
    driver: Any = held.driver_connection
    driver.autocommit = True

    async def work_with(work: Work) -> Any:
        pipeline = Pipeline(driver)
        try:
            return await work(pipeline)
        finally:
            pipeline.close()

    yield lambda work: asyncio.run(work_with(work))
    held.invalidate()
    held.close()


def test_each_statement_of_a_trip_has_its_own_rows(with_pipeline: Callable[[Work], Any]) -> None:
    async def work(pipeline: Pipeline) -> Any:
        await pipeline.trip([("CREATE TEMPORARY TABLE t (n bigint, x float8, w text)", ())])
        said = [(1, 0.1, "ä'\\ %s"), (2**62, 1e-300, ""), (None, None, None)]
        insert = "INSERT INTO t SELECT %s, %s, %s"
        first = await pipeline.trip(
            [(insert, one) for one in said] + [("SELECT * FROM t WHERE 5 %% 2 = 1", ())]
        )
        again = await pipeline.trip([("SELECT %s::bool, count(*) FROM t", (True,)), ("BEGIN", ())])
        return said, first, again

    said, first, again = with_pipeline(work)
    assert first == [[], [], [], said]
    assert again == [[(True, 3)], []]


def test_a_trip_of_many_megabytes_both_ways_arrives_whole(
    with_pipeline: Callable[[Work], Any],
) -> None:
    texts = [letter * 3_000_000 for letter in "abc"]

    async def work(pipeline: Pipeline) -> Any:
        return await pipeline.trip([("SELECT %s::text", (text,)) for text in texts])

    assert with_pipeline(work) == [[(text,)] for text in texts]


def test_what_the_server_refuses_is_the_drivers_error(with_pipeline: Callable[[Work], Any]) -> None:
    async def work(pipeline: Pipeline) -> Any:
        return await pipeline.trip([("SELECT 1", ()), ("SELECT 1 / %s::int", (0,))])

    with pytest.raises(psycopg.errors.DivisionByZero):
        with_pipeline(work)


@pytest.mark.parametrize("asleep", [False, True], ids=["between trips", "in a trip"])
def test_a_server_that_hangs_up_fails_the_trip_and_not_the_event_loop(
    with_pipeline: Callable[[Work], Any], engine: Engine, asleep: bool
) -> None:
    def end(backend: int) -> None:
        with engine.connect() as connection:
            connection.exec_driver_sql(f"SELECT pg_terminate_backend({backend})")

    async def work(pipeline: Pipeline) -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, told: odd.append(told))
        (((backend,),),) = await pipeline.trip([("SELECT pg_backend_pid()", ())])
        if asleep:
            sleeping = asyncio.create_task(pipeline.trip([("SELECT pg_sleep(30)", ())]))
            await asyncio.to_thread(end, backend)
            await sleeping
        await asyncio.to_thread(end, backend)
        await asyncio.sleep(0.1)
        await pipeline.trip([("SELECT 1", ())])

    odd: list[dict[str, Any]] = []
    with pytest.raises(psycopg.OperationalError):
        with_pipeline(work)
    assert odd == []
