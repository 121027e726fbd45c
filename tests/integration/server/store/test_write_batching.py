"""Transactions that wait for their turn together share one, and none spoils the others."""

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.engine import Connection, Engine

from server.store.database.engine import create_engine, reading, writing
from server.store.database.write_batching import WriteBatches, run_batch

Job = Callable[[Connection], str]
Batches = WriteBatches[Job, str]

TABLE = sa.table("told", sa.column("word"))


@pytest.fixture
def told(engine: Engine) -> Iterator[Callable[[], list[str]]]:
    """A table that jobs write into; returns what is in it."""
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE told (word TEXT)")

    def read() -> list[str]:
        with reading(engine) as connection:
            return sorted(connection.scalars(sa.select(TABLE.c.word)))

    yield read
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE told")


def tell(word: str) -> Callable[[Connection], str]:
    """A job that writes a word and returns it."""

    def job(connection: Connection) -> str:
        connection.execute(sa.insert(TABLE).values(word=word))
        return word.upper()

    return job


def fail(connection: Connection) -> str:
    """A job that writes and then cannot go on."""
    connection.execute(sa.insert(TABLE).values(word="half"))
    raise ZeroDivisionError


def serve(connection: Connection, jobs: Sequence[Job]) -> list[str]:
    """Do what is asked, one after the other."""
    return [job(connection) for job in jobs]


def run(engine: Engine, ask: Callable[[Batches], Coroutine[Any, Any, Any]]) -> Any:
    """Return what a coroutine makes of batches on a database."""
    batches = WriteBatches(engine, serve)
    try:
        return asyncio.run(ask(batches))
    finally:
        batches.close()


async def all_at_once(batches: Batches, jobs: list[Job]) -> list[Any]:
    return list(await asyncio.gather(*map(batches, jobs), return_exceptions=True))


def test_each_gets_its_own_answer_when_its_work_is_committed(
    engine: Engine, told: Callable[[], list[str]]
) -> None:
    words = [f"word {number:02d}" for number in range(20)]

    async def ask(batches: Batches) -> list[str]:
        async def one(word: str) -> str:
            said: str = await batches(tell(word))
            assert word in await asyncio.to_thread(told)
            return said

        return list(await asyncio.gather(*map(one, words)))

    assert run(engine, ask) == [word.upper() for word in words]
    assert told() == words


def test_what_fails_leaves_nothing_and_spoils_nobody_else(
    engine: Engine, told: Callable[[], list[str]]
) -> None:
    jobs = [tell("a"), fail, tell("b"), fail, tell("c")]
    answers = run(engine, lambda batches: all_at_once(batches, jobs))
    assert [str(a) for a in answers if not isinstance(a, ZeroDivisionError)] == ["A", "B", "C"]
    assert told() == ["a", "b", "c"]


def test_on_sqlite_those_that_wait_share_a_commit(engine: Engine, told: Any) -> None:
    commits: list[Connection] = []
    event.listen(engine, "commit", commits.append)
    run(engine, lambda batches: all_at_once(batches, [tell(str(n)) for n in range(10)]))
    # Whoever comes first waits for nobody.
    assert len(commits) <= 2 if engine.dialect.name == "sqlite" else len(commits) == 10
    assert len(told()) == 10


def test_on_sqlite_who_comes_while_a_turn_is_about_to_begin_shares_it(
    engine: Engine, told: Any
) -> None:
    commits: list[Connection] = []
    event.listen(engine, "commit", commits.append)

    async def ask(batches: Batches) -> list[str]:
        async def later(word: str) -> str:
            await asyncio.sleep(0)
            return await batches(tell(word))

        return await asyncio.gather(batches(tell("a")), later("b"))

    assert run(engine, ask) == ["A", "B"]
    assert len(commits) == (1 if engine.dialect.name == "sqlite" else 2)


def test_nobody_is_told_that_it_is_done_if_the_commit_fails(engine: Engine, told: Any) -> None:
    def refuse(_connection: Connection) -> None:
        raise OSError("the disk is full")

    event.listen(engine, "commit", refuse)
    answers = run(engine, lambda batches: all_at_once(batches, [tell("a"), tell("b"), tell("c")]))
    event.remove(engine, "commit", refuse)
    assert [str(answer) for answer in answers] == ["the disk is full"] * 3
    assert told() == []


def test_a_transaction_that_fails_is_tried_again_job_by_job(engine: Engine, told: Any) -> None:
    outcomes = run_batch(engine, serve, [tell("a"), fail, tell("b")])
    assert [result for result, _ in outcomes] == ["A", None, "B"]
    assert isinstance(outcomes[1][1], ZeroDivisionError)
    assert told() == ["a", "b"]


def test_who_stops_waiting_does_not_keep_the_others_from_their_answers(
    engine: Engine, told: Any
) -> None:
    async def ask(batches: Batches) -> list[Any]:
        impatient = asyncio.ensure_future(batches(tell("impatient")))
        others = asyncio.ensure_future(all_at_once(batches, [tell("a"), tell("b")]))
        await asyncio.sleep(0)
        impatient.cancel()
        return await others

    assert run(engine, ask) == ["A", "B"]


def test_who_writes_for_long_keeps_no_event_loop_waiting(
    engine: Engine, told: Callable[[], list[str]]
) -> None:
    entered, leave = threading.Event(), threading.Event()

    def write_for_long() -> None:
        with writing(engine) as connection:
            tell("long")(connection)
            entered.set()
            leave.wait(20.0)

    async def ask(batches: Batches) -> str:
        other = asyncio.create_task(asyncio.to_thread(write_for_long))
        await asyncio.to_thread(entered.wait, 20.0)
        mine = asyncio.create_task(batches(tell("mine")))
        # The loop goes on, whoever waits for the database.
        await asyncio.sleep(0.05)
        leave.set()
        await other
        return await mine

    assert run(engine, ask) == "MINE"
    assert told() == ["long", "mine"]


def test_sqlite_s_log_is_copied_into_the_file_now_and_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.store.database.files.LOG_PAGES", 20)
    monkeypatch.setattr("server.store.database.write_batching.UPKEEP", 10)
    engine = create_engine(f"sqlite:///{tmp_path}/told.sqlite3")
    with writing(engine) as connection:
        connection.exec_driver_sql("CREATE TABLE told (word TEXT)")

    async def ask(batches: Batches) -> None:
        for _ in range(60):
            await batches(tell("x" * 4000))

    run(engine, ask)
    # 60 transactions write two pages or more each; the log begins anew when it was copied.
    log = (tmp_path / "told.sqlite3-wal").stat().st_size
    engine.dispose()
    assert 0 < log < 60 * 4096
