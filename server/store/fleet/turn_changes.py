"""What a turn writes, and in which statements."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.engine import Dialect

from models.curves import packed
from server.records import Comparison, Instance, Introduction, Lease, Place, Result, Study
from server.states import InstanceState, LeaseState
from server.store.database.prepared import Words
from server.store.fleet import comparisons, results
from server.store.fleet import turn_statements as sql
from server.store.study import instances, studies

#: How JSON writes a character that PostgreSQL keeps in JSON, but not where it takes JSON apart.
_NUL = "\\u0000"


@dataclass(kw_only=True, slots=True)
class Changes:
    """What a turn writes. Everything is of its one study."""

    #: Who asked, with the kind of machine and final results brought; the last word of each counts.
    workers: list[tuple[Introduction, str, int]] = field(default_factory=list)
    #: Who only brought results, and how many final ones.
    heard: dict[str, int] = field(default_factory=dict)
    #: Leases to last until then, by moment; and those that hold nothing any more.
    extended: dict[float, list[str]] = field(default_factory=dict)
    finished: list[str] = field(default_factory=list)
    #: Of these leases everything that they held is done; all in these rows.
    emptied: list[str] = field(default_factory=list)
    emptied_rows: list[int] = field(default_factory=list)
    #: Other instances that are done, and instances of begun rows handed out: with their lease.
    done: list[Place] = field(default_factory=list)
    handed_out: list[tuple[Place, str]] = field(default_factory=list)
    #: Instances with which something went wrong.
    rewritten: list[Instance] = field(default_factory=list)
    #: Rows that any kind of machine could have taken, and the kind that has.
    bound: list[tuple[int, str]] = field(default_factory=list)
    #: Instances of new rows: lease or None, kind of machine.
    begun: dict[Place, tuple[str | None, str]] = field(default_factory=dict)
    granted: list[Lease] = field(default_factory=list)
    #: Final results in the order of their numbers, and who brought each.
    filed: list[tuple[str, Result]] = field(default_factory=list)
    #: Results that contradict final ones.
    conflicts: list[tuple[str, Result]] = field(default_factory=list)
    #: Second opinions to ask for: first host, its worker, place; and those that changed.
    asked: list[tuple[str, str, Place]] = field(default_factory=list)
    compared: list[Comparison] = field(default_factory=list)

    def statements(
        self, dialect: Dialect, before: Study | None, study: Study | None, now: float
    ) -> Iterator[Words]:
        """Yield what writes them.

        Old leases first, then workers by name, as renewals do: nobody waits in a circle. New leases
        and results name workers, who must be there.

        Args:
            dialect: of the database.
            before: the study of the turn, as it is stored.
            study: the same as it is now; None if there is none.
            now: when all that happened.
        """
        kind = dialect.name
        for until, ids in self.extended.items():
            yield from sql.EXTEND.words(kind, until, now, ids)
        if self.finished:
            yield from sql.END.words(kind, LeaseState.FINISHED, self.finished)
        if self.workers:
            yield from sql.INTRODUCE.words(kind, now, _introduced(self.workers))
        if self.heard:
            yield from sql.HEARD.words(kind, now, sorted(self.heard.items()))
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
                yield statement.words(dialect, *given)

    def _of_instances(self, dialect: Dialect, study: Study) -> Iterator[Words]:
        kind = dialect.name
        if self.emptied:
            where = study.id, min(self.emptied_rows), max(self.emptied_rows)
            yield from sql.EMPTY.words(kind, InstanceState.DONE, *where, self.emptied)
        yield from _moved(dialect, study, InstanceState.DONE, [(one, None) for one in self.done])
        for one in self.rewritten:
            yield instances.REWRITE.words(dialect, *instances.to_row(study.id, one))
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
            yield from sql.BEGIN.words(kind, study.id, begun)
        yield from _moved(dialect, study, InstanceState.LEASED, self.handed_out)
        for row, host_class in self.bound:
            yield instances.BIND.words(dialect, host_class, study.id, row)

    def _of_results(
        self, dialect: Dialect, study: Study, first: int, now: float
    ) -> Iterator[Words]:
        kind = dialect.name
        if self.granted:
            granted = [
                (one.id, one.worker, one.expires_at, one.instances, one.host_class, one.compares)
                for one in self.granted
            ]
            yield from sql.LEASE.words(kind, study.id, now, granted)
        if self.filed:
            filed = _numbered(self.filed, first)
            told = sql.APPEND.words(kind, study.id, now, filed)
            if kind == "sqlite" or _NUL not in told[0][1][-1]:
                yield from told
            else:
                for row in filed:
                    yield results.one(dialect, (study.id, now), row)
        for worker, result in self.conflicts:
            yield results.conflict(dialect, study.id, worker, now, result)
        if self.asked:
            asked = [(host, worker, *place) for host, worker, place in self.asked]
            yield from sql.ASK.words(kind, study.id, now, asked)
        for compared in self.compared:
            yield comparisons.saving(dialect, compared)


def _moved(
    dialect: Dialect, study: Study, state: InstanceState, moved: Sequence[tuple[Place, str | None]]
) -> Iterator[Words]:
    """Yield what gives instances a state, and each its lease."""
    if dialect.name == "sqlite":
        for (row, position), lease in moved:
            yield instances.MOVE.words(dialect, state, lease, study.id, row, position)
    elif moved:
        rows = [(*place, lease) for place, lease in moved]
        yield from sql.MOVE.words(dialect.name, state, rows, study.id)


def _introduced(found: Sequence[tuple[Introduction, str, int]]) -> list[tuple[Any, ...]]:
    """Return what is known of each worker, however often it spoke."""
    done: dict[str, int] = {}
    rows: dict[str, tuple[Any, ...]] = {}
    for worker, kind, brought in found:
        done[worker.id] = done.get(worker.id, 0) + brought
        rows[worker.id] = (
            worker.id,
            done[worker.id],
            worker.host,
            dict(worker.versions),
            kind,
            list(worker.tags),
            dict(worker.models),
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
