"""Turns on PostgreSQL: one transaction for all who wait, in statements over sets of rows.

Waiting for the server dominates there, so a turn is three trips, each a pipeline, however many
requests it serves. Rows go there as one text of JSON: to write arrays takes the driver a third of
the time of a turn. Joins to them are planned without statistics; on the connection of the turns
only look-ups by index are allowed, or a plan made on an empty table would read the whole study.
Each statement is planned once, since to plan takes longer than to execute.
"""

from collections.abc import AsyncIterator, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

from sqlalchemy.engine import Engine

from server.records import Instance, Introduction, Lease, Place, Result, Study, record
from server.states import InstanceState, LeaseState
from server.store.database.prepared import as_text
from server.store.fleet import leases
from server.store.fleet import turn_statements as sql
from server.store.study import instances, studies
from server.threads import in_thread

if TYPE_CHECKING:
    from server.store.database.pipeline import Pipeline, Rows, Statement

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
    """What a turn must know to decide who can be served in it."""

    #: Those that were asked for, by id, leaving out unknown ones.
    leases: Mapping[str, Lease]
    #: Studies with something to hand out, by id and model, first to serve first.
    work: Sequence[tuple[str, str]]
    #: Hosts whose second opinion is wanted, and whether one of them has waited long enough.
    opinions: Mapping[str, bool]


@record
class Slots:
    """Instances that a turn may change."""

    #: All of the rows that were asked for.
    rows: Mapping[Place, Instance]
    #: Those that wait for a machine, by the kind of machine that was asked for.
    pending: Mapping[str, Sequence[Instance]]
    #: Whether any waits for whatever machine.
    unbound: bool


@record
class Changes:
    """What a turn writes. Everything is of its one study."""

    #: None: nothing of it changes.
    study: Study | None
    #: Whether nothing of the study has changed but how many of its instances are where.
    counted: bool
    now: float
    #: Who asked, with the kind of machine and final results brought; the last word of each counts.
    workers: Sequence[tuple[Introduction, str, int]]
    #: Who only brought results, and how many final ones.
    heard: Mapping[str, int]
    #: Leases to last until then, by moment; and those that hold nothing any more.
    extended: Mapping[float, Sequence[str]]
    finished: Sequence[str]
    #: Of these everything that they hold is done; all in these rows.
    emptied: Sequence[str]
    emptied_rows: tuple[int, int]
    #: Other instances that are done, and instances of begun rows handed out: with their lease.
    done: Sequence[Place]
    handed_out: Sequence[tuple[Place, str]]
    #: Instances of new rows: lease or None, kind of machine.
    begun: Mapping[Place, tuple[str | None, str]]
    granted: Sequence[Lease]
    #: Final results in the order of their numbers, the first of them, and who brought each.
    filed: Sequence[tuple[str, Result]]
    first: int
    #: Second opinions to ask for: first host, its worker, place.
    asked: Sequence[tuple[str, str, Place]]


class TurnConnection:
    """The connection of the turns; for one event loop, and one turn at a time."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._held: Any = None
        self._pipeline: Pipeline | None = None
        #: By study and kind of machine the first row in which an instance was found waiting: before
        #: it the index holds little but what is dead.
        self._first_pending: dict[tuple[str, str], int] = {}

    @asynccontextmanager
    async def turn(self) -> AsyncIterator["Turn"]:
        """Open a transaction that is committed by `Turn.write`, else rolled back."""
        try:
            if self._pipeline is None:
                self._pipeline = await in_thread(self._open)
            turn = Turn(self._pipeline, self._engine, self._first_pending)
            yield turn
            if not turn.committed:
                await turn.trip([("ROLLBACK", ())])
        except BaseException:
            # Whatever state it is in, nobody wants to know.
            self.close()
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
    """One transaction."""

    def __init__(
        self, pipeline: "Pipeline", engine: Engine, first_pending: dict[tuple[str, str], int]
    ) -> None:
        self.trip = pipeline.trip
        self._dialect = engine.dialect
        self._first_pending = first_pending
        self.committed = False

    async def lock(self, study_id: str) -> Study | None:
        """Begin, and lock a study; None if there is none of that id."""
        _, found = await self.trip(
            [("BEGIN", ()), studies.FIND_LOCKED.words(self._dialect, study_id)]
        )
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
    ) -> tuple[Seen, Slots]:
        """Return what there is to do, and what is about these leases, hosts and rows.

        Args:
            study: the one that is locked; None: there are no slots.
            leases_of: ids of leases.
            hosts: names of machines.
            asked_by: second opinions that were asked for by then have waited long enough.
            rows: of the study, whose instances are wanted.
            wanted: how many instances that wait are wanted, by the kind of machine asking.
        """
        asks = wanted if study is not None and study.returned else {}
        id_ = "" if study is None else study.id
        hints = {kind: self._first_pending.get((id_, kind), 0) for kind in asks}
        statements: list[Statement] = [
            leases.FIND_ANY.words(self._dialect, _array(leases_of)),
            (sql.WORK, ()),
            (sql.OPINIONS, (_array(hosts), asked_by)),
            _in_rows(id_, rows),
        ]
        if asks:
            statements.append((sql.UNBOUND, (id_,)))
        statements += [(sql.PENDING, (id_, kind, hints[kind], most)) for kind, most in asks.items()]
        known, work, opinions, in_rows, *waiting = await self.trip(statements)
        pending = {}
        for (kind, most), here in zip(asks.items(), waiting[1:], strict=True):
            if len(here) < most and hints[kind]:
                (here,) = await self.trip([(sql.PENDING, (id_, kind, 0, most))])
            self._note(id_, kind, here)
            pending[kind] = [instances.from_row(row) for row in here]
        seen = Seen(
            leases={row[0]: leases.lease_of(row) for row in known},
            work=[(study_id, model) for study_id, model in work],
            opinions=dict(opinions),
        )
        slots = Slots(rows=_by_place(in_rows), pending=pending, unbound=bool(asks and waiting[0]))
        return seen, slots

    async def rows(self, study: Study, rows: Collection[int]) -> dict[Place, Instance]:
        """Return the instances of rows."""
        (found,) = await self.trip([_in_rows(study.id, rows)])
        return _by_place(found)

    async def write(self, changes: Changes) -> dict[str, int]:
        """Write changes and commit; returns the fences of the new leases."""
        *found, _ = await self.trip([*self._statements(changes), ("COMMIT", ())])
        self.committed = True
        # Only the statement about leases returns anything.
        return {lease: fence for rows in found for lease, fence in rows}

    def _note(self, study_id: str, kind: str, rows: "Rows") -> None:
        if len(self._first_pending) > 1000:
            self._first_pending.clear()
        self._first_pending[study_id, kind] = rows[0][0] if rows else 0

    def _statements(self, changes: Changes) -> "Iterator[Statement]":
        """Yield what writes changes.

        Old leases first, then workers by name, as renewals do: nobody waits in a circle. New leases
        and results name workers, who must be there.
        """
        now = changes.now
        for until, ids in changes.extended.items():
            yield sql.EXTEND, (until, _array(ids), now)
        if changes.finished:
            yield sql.END, (LeaseState.FINISHED, _array(changes.finished))
        if changes.workers:
            yield sql.INTRODUCE, (now, as_text(_told(changes.workers)))
        if changes.heard:
            heard = [{"name": w, "done": changes.heard[w]} for w in sorted(changes.heard)]
            yield sql.HEARD, (now, as_text(heard))
        if changes.study is not None:
            yield from self._of_study(changes, changes.study)

    def _of_study(self, changes: Changes, study: Study) -> "Iterator[Statement]":
        now = changes.now
        if changes.emptied:
            values = (InstanceState.DONE, study.id, *changes.emptied_rows, _array(changes.emptied))
            yield sql.EMPTY, values
        if changes.done:
            done = [{"row": row, "position": position} for row, position in changes.done]
            yield sql.MOVE, (InstanceState.DONE, as_text(done), study.id)
        if changes.begun:
            begun = [
                {
                    "row": row,
                    "position": position,
                    "state": InstanceState.PENDING if lease is None else InstanceState.LEASED,
                    "lease_id": lease,
                    "host_class": kind,
                }
                for (row, position), (lease, kind) in changes.begun.items()
            ]
            yield sql.BEGIN, (study.id, as_text(begun))
        if changes.handed_out:
            moved = [
                {"row": row, "position": position, "lease_id": lease}
                for (row, position), lease in changes.handed_out
            ]
            yield sql.MOVE, (InstanceState.LEASED, as_text(moved), study.id)
        if changes.granted:
            granted = [
                {
                    "id": one.id,
                    "worker_id": one.worker,
                    "expires_at": one.expires_at,
                    "instances": one.instances,
                    "host_class": one.host_class,
                }
                for one in changes.granted
            ]
            yield sql.LEASE, (study.id, now, as_text(granted))
        if changes.filed:
            yield sql.APPEND, (study.id, now, as_text(_numbered(changes)))
        if changes.asked:
            asked = [
                {"host": host, "worker_id": worker, "row": row, "position": position}
                for host, worker, (row, position) in changes.asked
            ]
            yield sql.ASK, (study.id, now, as_text(asked))
        if changes.granted or changes.filed:
            statement, given = studies.saving(study, counted=changes.counted)
            yield statement.words(self._dialect, *given)


def _in_rows(study_id: str, rows: Collection[int]) -> "Statement":
    return sql.IN_ROWS, (_array(sorted(rows)), study_id)


def _by_place(found: "Rows") -> dict[Place, Instance]:
    return {(row[0], row[1]): instances.from_row(row) for row in found}


def _told(found: Sequence[tuple[Introduction, str, int]]) -> list[dict[str, Any]]:
    """Return what is known of each worker, however often it spoke."""
    rows: dict[str, dict[str, Any]] = {}
    for worker, kind, done in found:
        before = rows[worker.id]["done"] if worker.id in rows else 0
        rows[worker.id] = {
            "id": worker.id,
            "done": before + done,
            "host": worker.host,
            "versions": dict(worker.versions),
            "host_class": kind,
            "tags": list(worker.tags),
            "models": dict(worker.models),
        }
    return [*rows.values()]


def _numbered(changes: Changes) -> list[dict[str, Any]]:
    return [
        {
            "worker_id": worker,
            "seq": seq,
            "row": result.row,
            "position": result.position,
            "outcome": result.outcome,
            "outputs": result.outputs,
            "reason": result.reason,
            "state": result.state,
            "wall_seconds": result.wall_seconds,
        }
        for seq, (worker, result) in enumerate(changes.filed, start=changes.first)
    ]


def _array(values: Iterable[object]) -> str:
    """Return values as PostgreSQL writes an array, in a tenth of the time the driver takes."""
    quoted = (str(one).replace("\\", "\\\\").replace('"', '\\"') for one in values)
    return "{" + ",".join(f'"{one}"' for one in quoted) + "}"
