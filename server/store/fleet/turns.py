"""Turns: what happens to one study in one transaction, however many have asked for it.

A turn is three trips to the database, each some statements over sets of rows, however many requests
it serves; it makes others where something rare is asked. On PostgreSQL, where waiting for the
server dominates, a trip is a pipeline. Joins to sets are planned without statistics there; on the
connection of the turns only look-ups by index are allowed, or a plan made on an empty table would
read the whole study. Each statement is planned once, since to plan takes longer than to execute.
"""

from collections.abc import (
    AsyncIterator,
    Awaitable,
    Callable,
    Collection,
    Coroutine,
    Mapping,
    Sequence,
)
from contextlib import asynccontextmanager, suppress
from dataclasses import field
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, TypeVar

from sqlalchemy.engine import Connection, Dialect, Engine

from server.records import Comparison, Instance, Lease, Place, Result, Study, record
from server.store import models
from server.store.database.engine import noted
from server.store.database.prepared import Statement, failure
from server.store.fleet import comparisons, leases, results
from server.store.fleet import turn_statements as sql
from server.store.fleet.turn_changes import Changes
from server.store.study import instances, studies
from server.threads import in_thread

if TYPE_CHECKING:
    from server.store.database.pipeline import Pipeline

T = TypeVar("T")

Rows = list[tuple[Any, ...]]

#: So often the first instance that waits is looked for from the first row on, though a later one is
#: known: one that came back since then may be before it.
AFRESH = 20

_SETTINGS = {
    "enable_hashjoin": "off",
    "enable_mergejoin": "off",
    "enable_seqscan": "off",
    # An array of one id looks cheaper than one of any length, and would be planned for each time.
    "plan_cache_mode": "force_generic_plan",
    # Milliseconds. A coordinator that stops in the middle of a turn, or whose machine is cut off,
    # would keep the study from all others until the network notices, which takes two hours.
    "idle_in_transaction_session_timeout": "15000",
}


@record
class Seen:
    """What a turn has read to decide what it can."""

    #: Those that were asked for, by id, leaving out unknown ones.
    leases: Mapping[str, Lease] = field(default_factory=dict)
    #: Studies with something to hand out, by id and model, first to serve first.
    work: Sequence[tuple[str, str]] = ()
    #: Hosts whose second opinion is wanted, and whether one of them has waited long enough.
    opinions: Mapping[str, bool] = field(default_factory=dict)
    #: All instances of the rows that were asked for.
    rows: Mapping[Place, Instance] = field(default_factory=dict)
    #: Instances that wait for a machine, by the host class that was asked for.
    pending: Mapping[str, Sequence[Instance]] = field(default_factory=dict)
    #: Whether any waits for whatever machine.
    unbound: bool = False


class TurnConnection:
    """The connection of the turns on PostgreSQL; for one event loop, and one turn at a time."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._held: Any = None
        self._pipeline: Pipeline | None = None
        #: By study and host class the first row in which an instance was found waiting: before
        #: it the index holds little but what is dead. Forgotten at every `AFRESH`th turn.
        self._first_pending: dict[tuple[str, str], int] = {}
        self._turns = 0

    @asynccontextmanager
    async def turn(self) -> AsyncIterator["Turn"]:
        """Open a transaction that is committed by `Turn.write`, else rolled back."""
        self._turns += 1
        if self._turns % AFRESH == 0:
            self._first_pending.clear()
        with noted(self._engine):
            try:
                if self._pipeline is None:
                    self._pipeline = await in_thread(self._open)
                turn = Turn(
                    self._pipeline.trip,
                    self._engine.dialect,
                    self._first_pending,
                    begin=[("BEGIN", ())],
                    end=[("COMMIT", ())],
                )
                yield turn
                if not turn.committed:
                    await turn.trip([("ROLLBACK", ())])
            except BaseException as error:
                # Whatever state it is in, nobody wants to know.
                self.close()
                if isinstance(error, self._engine.dialect.loaded_dbapi.Error):
                    raise failure(error, self._engine.dialect, "of a turn", ()) from error
                raise

    def close(self) -> None:
        """Close the connection; the next turn opens another."""
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            pipeline.close()
        held, self._held = self._held, None
        if held is not None:
            with suppress(Exception):
                held.invalidate()
            held.close()

    def _open(self) -> "Pipeline":
        # Its driver is there only where PostgreSQL is used.
        from server.store.database.pipeline import Pipeline

        self._held = self._engine.raw_connection()
        driver = self._held.driver_connection
        # Transactions are begun and ended in the trips themselves.
        driver.autocommit = True
        for name, value in _SETTINGS.items():
            driver.execute(f"SET {name} = {value}")
        return Pipeline(driver)


class Turn:
    """One transaction.

    Args:
        trip: executes statements, and returns the rows of each.
        dialect: of the database.
        first_pending: as `TurnConnection` has it; it is kept up.
        begin: what begins the transaction, along with the first trip, and
        end: what ends it; nothing if others do.
    """

    def __init__(
        self,
        trip: Callable[[Sequence[Statement]], Awaitable[list[Rows]]],
        dialect: Dialect,
        first_pending: dict[tuple[str, str], int],
        *,
        begin: Sequence[Statement] = (),
        end: Sequence[Statement] = (),
    ) -> None:
        self.trip = trip
        self.dialect = dialect
        self._first_pending = first_pending
        self._begin, self._end = begin, end
        self.committed = False

    async def lock(self, study_id: str) -> Study | None:
        """Lock a study; None if there is none of that id."""
        (found,) = await self._ask([studies.FIND_LOCKED.statement(self.dialect, study_id)])
        return studies.study_of(found[0]) if found else None

    async def look(
        self,
        study: Study | None,
        *,
        leases_of: Collection[str],
        hosts: Collection[str],
        asked_by: float,
        rows: Collection[int],
        wanted: Mapping[str, int],
    ) -> Seen:
        """Return what there is to do, and what is about these leases, hosts and rows.

        Args:
            study: the one that is locked; None: there are no instances.
            leases_of: ids of leases.
            hosts: names of machines.
            asked_by: second opinions that were asked for by then have waited long enough.
            rows: of the study, whose instances are wanted.
            wanted: how many instances that wait are wanted, by the host class that asks.
        """
        asks = wanted if study is not None and study.returned else {}
        id_ = "" if study is None else study.id
        hints = {host_class: self._first_pending.get((id_, host_class), 0) for host_class in asks}
        known, work, opinions, in_rows, unbound, *waiting = await self._ask(
            sql.LEASES.statements(self.dialect, [*leases_of]) if leases_of else (),
            *self._wanted(hosts, asked_by),
            self._in_rows(id_, rows),
            sql.UNBOUND.statements(self.dialect, id_) if asks else (),
            *(
                self._pending(id_, host_class, hints[host_class], most)
                for host_class, most in asks.items()
            ),
        )
        pending = {}
        # None waits before the first that was known, if those that were found are all there are.
        before = study is not None and study.returned > sum(map(len, waiting))
        for (host_class, most), here in zip(asks.items(), waiting, strict=True):
            if before and len(here) < most and hints[host_class]:
                (here,) = await self._ask(self._pending(id_, host_class, 0, most))
            self._first_pending[id_, host_class] = here[0][0] if here else 0
            pending[host_class] = [instances.from_row(row) for row in here]
        first_served, due = _wanted(work, opinions)
        return Seen(
            leases={row[0]: leases.lease_of(row) for row in known},
            work=first_served,
            opinions=due,
            rows=_by_place(in_rows),
            pending=pending,
            unbound=bool(unbound),
        )

    async def rows(self, study: Study, rows: Collection[int]) -> dict[Place, Instance]:
        """Return the instances of rows."""
        (found,) = await self._ask(self._in_rows(study.id, rows))
        return _by_place(found)

    async def write(
        self, changes: Changes, before: Study | None, study: Study | None, *, now: float, end: bool
    ) -> dict[str, int]:
        """Write changes, see `Changes.statements`; `end`: and commit.

        Returns:
            The fences of the new leases.
        """
        statements = changes.statements(self.dialect, before, study, now)
        found = await self.trip([*statements, *(self._end if end else ())])
        self.committed = end
        # Those who are locked have a name and no more.
        return {row[0]: int(row[1]) for rows in found for row in rows if len(row) == 2}

    async def wanted(
        self, hosts: Collection[str], *, asked_by: float
    ) -> tuple[Sequence[tuple[str, str]], Mapping[str, bool]]:
        """Return work and opinions as `Seen` has them."""
        return _wanted(*await self._ask(*self._wanted(hosts, asked_by)))

    async def study(self, study_id: str) -> Study | None:
        """Return a study that is not locked; None if it is gone."""
        (found,) = await self.trip([studies.FIND.statement(self.dialect, study_id)])
        return studies.study_of(found[0]) if found else None

    async def returned(
        self, study: Study, host_class: str, host: str, *, tried: bool | None, limit: int
    ) -> list[Instance]:
        """Return instances that wait for a machine; see `instances.pending`."""
        asked = instances.pending(
            self.dialect, study.id, host_class, host, tried=tried, limit=limit
        )
        (found,) = await self._ask(asked)
        first = sorted(found, key=lambda row: row[:2])[:limit]
        return [instances.from_row(row) for row in first]

    async def results_at(self, study: Study, places: Collection[Place]) -> dict[Place, Result]:
        """Return the final results at places, leaving out those that have none."""
        rows = sorted({row for row, _ in places})
        asked = [results.OF_ROW.statement(self.dialect, study.id, row) for row in rows]
        (found,) = await self._ask(asked)
        stored = map(results.result_of, found)
        by_place = {(result.row, result.position): result for result in stored}
        return {place: by_place[place] for place in places if place in by_place}

    async def is_deterministic(self, model: str) -> bool:
        """Say whether another machine would compute the same; as far as is known it would."""
        (found,) = await self.trip([models.DESCRIPTION.statement(self.dialect, model)])
        return not found or models.description_of(found[0]).deterministic

    async def opinions_wanted(self, host: str, *, asked_by: float) -> list[str]:
        """Return the studies in which a second opinion of `host` was asked for by then."""
        (found,) = await self.trip(
            [comparisons.STUDIES_WAITING.statement(self.dialect, host, asked_by)]
        )
        return [study_id for (study_id,) in found]

    async def opinions_for(self, study: Study, host: str, *, limit: int) -> list[Comparison]:
        """Return up to so many second opinions of `host` that are asked for."""
        (found,) = await self.trip(
            [comparisons.WAITING_FOR.statement(self.dialect, study.id, host, limit)]
        )
        return [comparisons.comparison_of(row) for row in found]

    async def opinions_of(self, lease: Lease) -> list[Comparison]:
        """Return what a lease was given."""
        (found,) = await self.trip([comparisons.OF_LEASE.statement(self.dialect, lease.id)])
        return [comparisons.comparison_of(row) for row in found]

    async def _ask(self, *parts: Sequence[Statement]) -> list[Rows]:
        """Return what each of some lists of statements finds, all in one trip."""
        every = [*self._begin, *chain.from_iterable(parts)]
        found = iter((await self.trip(every))[len(self._begin) :] if every else ())
        self._begin = ()
        return [[row for rows in islice(found, len(part)) for row in rows] for part in parts]

    def _wanted(self, hosts: Collection[str], asked_by: float) -> tuple[Sequence[Statement], ...]:
        opinions = sql.OPINIONS.statements(self.dialect, [*hosts], asked_by) if hosts else ()
        return sql.WORK.statements(self.dialect), opinions

    def _in_rows(self, study_id: str, rows: Collection[int]) -> Sequence[Statement]:
        return sql.IN_ROWS.statements(self.dialect, sorted(rows), study_id) if rows else ()

    def _pending(self, study_id: str, host_class: str, first: int, most: int) -> list[Statement]:
        return sql.PENDING.statements(self.dialect, study_id, host_class, first, most)


def turn_within(connection: Connection) -> Turn:
    """Return a turn within a transaction that others begin and end; see `at_once`."""
    driver: Any = connection.connection.dbapi_connection

    async def trip(statements: Sequence[Statement]) -> list[Rows]:
        found: list[Rows] = []
        for text, values in statements:
            try:
                cursor = driver.execute(text, values)
                found.append([] if cursor.description is None else cursor.fetchall())
            except connection.dialect.loaded_dbapi.Error as error:
                raise failure(error, connection.dialect, text, values) from error
        return found

    return Turn(trip, connection.dialect, {})


def at_once(turn: Coroutine[Any, Any, T]) -> T:
    """Return what comes of a turn of `turn_within`, which waits for no event loop."""
    try:
        turn.send(None)
    except StopIteration as end:
        found: T = end.value
        return found
    turn.close()
    raise RuntimeError("it waits for an event loop")


def _wanted(work: Rows, opinions: Rows) -> tuple[Sequence[tuple[str, str]], Mapping[str, bool]]:
    return (
        [(study_id, model) for study_id, model in work],
        {host: bool(due) for host, due in opinions},
    )


def _by_place(found: Rows) -> dict[Place, Instance]:
    return {(row[0], row[1]): instances.from_row(row) for row in found}
