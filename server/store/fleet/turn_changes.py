"""What is written about a study, and in which statements."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.engine import Dialect

from models.curves import packed
from server.records import Comparison, Instance, Introduction, Lease, Place, Result, Study
from server.states import InstanceState, LeaseState
from server.store.database.prepared import Statement
from server.store.fleet import comparisons, results
from server.store.fleet import turn_statements as sql
from server.store.study import instances, studies

#: How JSON writes a character that PostgreSQL keeps in JSON, but not where it takes JSON apart.
_NUL = "\\u0000"


@dataclass(kw_only=True, slots=True)
class Changes:
    """What is written in a turn, or when leases end. Everything is of one study."""

    #: Of the workers that later changes of the same transaction may be about, the ids.
    company: list[str] = field(default_factory=list)
    #: Who asked, with the host class and final results brought; the last word of each counts.
    workers: list[tuple[Introduction, str, int]] = field(default_factory=list)
    #: Who only brought results, and how many final ones.
    heard: dict[str, int] = field(default_factory=dict)
    #: Leases to last until then, by moment; and those that end, by how.
    extended: dict[float, list[str]] = field(default_factory=dict)
    ended: dict[LeaseState, list[str]] = field(default_factory=dict)
    #: Leases of which all that they held goes to one state, and in which rows that was.
    emptied: dict[InstanceState, tuple[list[str], list[int]]] = field(default_factory=dict)
    #: Other instances of begun rows, by the state they go to: each with its lease from then on.
    moved: dict[InstanceState, list[tuple[Place, str | None]]] = field(default_factory=dict)
    #: Instances with which something went wrong.
    rewritten: list[Instance] = field(default_factory=list)
    #: Rows that any host class could have taken, and the one that has.
    bound: list[tuple[int, str]] = field(default_factory=list)
    #: Instances of new rows: lease or None, host class.
    begun: dict[Place, tuple[str | None, str]] = field(default_factory=dict)
    granted: list[Lease] = field(default_factory=list)
    #: Final results in the order of their numbers, and who brought each.
    filed: list[tuple[str, Result]] = field(default_factory=list)
    #: Results that contradict final ones.
    conflicts: list[tuple[str, Result]] = field(default_factory=list)
    #: Second opinions to ask for: first host, its worker, place; and those that changed.
    asked: list[tuple[str, str, Place]] = field(default_factory=list)
    compared: list[Comparison] = field(default_factory=list)

    def add_outcomes(
        self,
        lease: str,
        before: Mapping[Place, Instance],
        after: Mapping[Place, Instance],
        *,
        whole: bool,
    ) -> None:
        """Note how instances now stand that were handed out, with as little as that needs.

        Args:
            lease: under which they were.
            before: how they were.
            after: how they are now: pending or done.
            whole: whether it held all of them, and holds nothing any more.
        """
        again = {place for place, one in after.items() if one.attempts != before[place].attempts}
        self.rewritten += [one for place, one in after.items() if place in again]
        states = {one.state for one in after.values()}
        if whole and not again and len(states) == 1:
            (state,) = states
            leases, rows = self.emptied.get(state, ([], []))
            rows = [*rows, *(row for row, _ in after)]
            # What is late may be far away, and everything in between would be looked at.
            if max(rows) - min(rows) <= 4 * len(rows):
                self.emptied[state] = [*leases, lease], rows
                return
        for place, one in after.items():
            if place not in again:
                self.moved.setdefault(one.state, []).append((place, None))

    def statements(
        self, dialect: Dialect, before: Study | None, study: Study | None, now: float
    ) -> Iterator[Statement]:
        """Yield what writes them.

        Whoever changes several locks studies first, then workers by name, then leases: so nobody
        waits in a circle. New leases and results name workers, who must be there.

        Args:
            dialect: of the database.
            before: the study of the turn, as it is stored.
            study: the same as it is now; None if there is none.
            now: when all that happened.
        """
        # Those who ask are locked by name as they are introduced.
        if dialect.name == "postgresql" and (self.company or self.heard):
            asked = (worker.id for worker, *_ in self.workers)
            yield from sql.LOCK_WORKERS.statements(dialect, [*{*self.company, *self.heard, *asked}])
        if self.workers:
            yield from sql.INTRODUCE.statements(dialect, now, _introduced(self.workers))
        if self.heard:
            yield from sql.HEARD.statements(dialect, now, [*self.heard.items()])
        for until, ids in self.extended.items():
            yield from sql.EXTEND.statements(dialect, until, LeaseState.OPEN, now, ids)
        for how, ids in self.ended.items():
            yield from sql.END.statements(dialect, how, LeaseState.OPEN, ids)
        if study is not None and before is not None:
            yield from self._of_instances(dialect, study)
            yield from self._of_results(dialect, study, before.result_count + 1, now)
            if study is not before:
                counted = (
                    study.failures is before.failures
                    and study.state == before.state
                    and study.identity is before.identity
                )
                statement, given = studies.saving(study, counted=counted)
                yield statement.statement(dialect, *given)

    def _of_instances(self, dialect: Dialect, study: Study) -> Iterator[Statement]:
        for state, (leases, rows) in self.emptied.items():
            yield from sql.EMPTY.statements(dialect, state, study.id, min(rows), max(rows), leases)
        for one in self.rewritten:
            yield instances.REWRITE.statement(dialect, *instances.to_row(study.id, one))
        if self.begun:
            begun = [
                (
                    row,
                    position,
                    InstanceState.PENDING if lease is None else InstanceState.LEASED,
                    lease,
                    host_class,
                )
                for (row, position), (lease, host_class) in self.begun.items()
            ]
            yield from sql.BEGIN.statements(dialect, study.id, begun)
        for state, moved in self.moved.items():
            yield from _moved(dialect, study, state, moved)
        for row, host_class in self.bound:
            yield instances.BIND.statement(dialect, host_class, study.id, row)

    def _of_results(
        self, dialect: Dialect, study: Study, first: int, now: float
    ) -> Iterator[Statement]:
        if self.granted:
            granted = [
                (one.id, one.worker, one.expires_at, one.instances, one.host_class, one.compares)
                for one in self.granted
            ]
            yield from sql.LEASE.statements(dialect, study.id, now, granted)
        if self.filed:
            filed = _numbered(self.filed, first)
            told = sql.APPEND.statements(dialect, study.id, now, filed)
            if dialect.name == "sqlite" or _NUL not in told[0][1][-1]:
                yield from told
            else:
                for row in filed:
                    yield results.one(dialect, (study.id, now), row)
        for worker, result in self.conflicts:
            yield results.conflict(dialect, study.id, worker, now, result)
        if self.asked:
            asked = [(host, worker, *place) for host, worker, place in self.asked]
            yield from sql.ASK.statements(dialect, study.id, now, asked)
        for compared in self.compared:
            yield comparisons.saving(dialect, compared)


def _moved(
    dialect: Dialect, study: Study, state: InstanceState, moved: Sequence[tuple[Place, str | None]]
) -> Iterator[Statement]:
    """Yield what gives instances a state, and each its lease."""
    if dialect.name == "sqlite":
        for (row, position), lease in moved:
            yield instances.MOVE.statement(dialect, state, lease, study.id, row, position)
    else:
        rows = [(*place, lease) for place, lease in moved]
        yield from sql.MOVE.statements(dialect, state, rows, study.id)


def _introduced(found: Sequence[tuple[Introduction, str, int]]) -> list[tuple[Any, ...]]:
    """Return what is known of each worker, however often it spoke."""
    done: dict[str, int] = {}
    rows: dict[str, tuple[Any, ...]] = {}
    for worker, host_class, brought in found:
        done[worker.id] = done.get(worker.id, 0) + brought
        rows[worker.id] = (
            worker.id,
            done[worker.id],
            worker.host,
            dict(worker.versions),
            host_class,
            list(worker.tags),
            dict(worker.models),
            dict(worker.refused),
        )
    return [*rows.values()]


def _numbered(filed: Iterable[tuple[str, Result]], first: int) -> list[tuple[Any, ...]]:
    return [
        (
            worker,
            seq,
            result.row,
            result.position,
            result.outcome,
            None if result.outputs is None else packed(result.outputs),
            result.reason,
            result.state,
            result.wall_seconds,
        )
        for seq, (worker, result) in enumerate(filed, start=first)
    ]
