"""A study in the course of a turn: what workers bring and ask, decided in memory.

It decides as `results` and `leasing` do one by one, and leaves to them whatever is unusual.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from server.logic.fleet.comparisons import is_chosen, is_comparable
from server.logic.fleet.hosts import identity, objection_to_worker
from server.logic.fleet.leases import expiry, objection_to_results
from server.logic.fleet.verdicts import Judgement, judge_all
from server.logic.study import studies as life
from server.logic.study.points import instance_id
from server.logic.study.studies import handed_out, new_rows
from server.operations.fleet import leasing
from server.operations.fleet.exchange import Answer, Exchange
from server.operations.fleet.leasing import Deferred, Grant, Ineligible, LeaseRequest
from server.operations.fleet.results import Post
from server.records import Instance, Lease, Place, Result, Study
from server.states import InstanceState, StudyState, Verdict
from server.store.database.prepared import as_text
from server.store.fleet.turns import Changes, Seen, Slots

#: How JSON writes a character that PostgreSQL's texts cannot hold.
NUL = "\\u0000"


class _UnusualError(Exception):
    """A request that a turn cannot serve."""


class ServedStudy:
    """A study in the course of a turn."""

    def __init__(self, study: Study | None, seen: Seen, slots: Slots) -> None:
        self._before = self._study = study
        self._seen = seen
        #: All instances of the rows that the turn is about, as they are now, row by row.
        self._rows: dict[int, dict[Place, Instance]] = {}
        self._pending = {kind: [*found] for kind, found in slots.pending.items()}
        self._unbound = slots.unbound
        self._workers: list[tuple[Any, str, int]] = []
        self._heard: dict[str, int] = {}
        self._extended: dict[float, list[str]] = {}
        self._finished: list[str] = []
        self._emptied: list[str] = []
        self._emptied_rows: list[int] = []
        self._done: list[Place] = []
        self._moved: list[tuple[Place, str]] = []
        self._begun: dict[Place, tuple[str | None, str]] = {}
        self._granted: list[Lease] = []
        self._filed: list[tuple[str, Result]] = []
        self._asked: list[tuple[str, str, Place]] = []
        self._now = 0.0
        self.fill(slots.rows)

    def rows_of(self, posts: Iterable[Post]) -> set[int]:
        """Return the rows in which the leases of posts hold anything."""
        mine = [self._seen.leases.get(post.lease) for post in posts]
        return {
            row
            for lease in mine
            if lease is not None and self._study is not None and lease.study == self._study.id
            for row, _ in lease.instances
        }

    def fill(self, rows: Mapping[Place, Instance]) -> None:
        """Take note of all instances of some rows, which may change."""
        for place, one in rows.items():
            self._rows.setdefault(place[0], {})[place] = one

    def serve(self, exchange: Exchange) -> Answer | None:
        """Serve one; None, and nothing is changed, if it is unusual."""
        self._now = max(self._now, exchange.now)
        judgements: list[Judgement] = []
        done = 0
        if exchange.posted is not None:
            try:
                judgements = self._file(exchange.posted, exchange.now, exchange.ttl)
            except _UnusualError:
                return None
            done = len(judgements)
        request, found = exchange.request, None
        if request is not None:
            found = self._grant(request, exchange.now, exchange.ttl)
            if exchange.posted is None and isinstance(found, Deferred):
                return None
        if exchange.posted is not None and (
            request is None or request.worker.id != exchange.posted.worker
        ):
            name = exchange.posted.worker
            self._heard[name] = self._heard.get(name, 0) + done
            done = 0
        if request is not None:
            self._workers.append((request.worker, request.host_class(), done))
        return judgements, found

    def changes(self) -> Changes | None:
        """Return what is to be written; None: nothing."""
        if not (self._workers or self._heard):
            return None
        before, study = self._before, self._study
        return Changes(
            study=study,
            counted=(
                study is not None
                and before is not None
                and study.failures is before.failures
                and study.state == before.state
                and study.identity is before.identity
            ),
            now=self._now,
            workers=self._workers,
            heard=self._heard,
            extended=self._extended,
            finished=self._finished,
            emptied=self._emptied,
            emptied_rows=(min(self._emptied_rows, default=0), max(self._emptied_rows, default=0)),
            done=self._done,
            handed_out=self._moved,
            begun=self._begun,
            granted=self._granted,
            filed=self._filed,
            first=0 if before is None else before.result_count + 1,
            asked=self._asked,
        )

    def _file(self, post: Post, now: float, ttl: float) -> list[Judgement]:
        """Take in results, all of them good ones for places that wait for them."""
        study, lease = self._study, self._seen.leases.get(post.lease)
        if (
            study is None
            or lease is None
            or lease.study != study.id
            or lease.compares
            or objection_to_results(lease, fence=post.fence, worker=post.worker) is not None
        ):
            raise _UnusualError
        places = {instance_id(study.id, *place): place for place in lease.instances}
        before: dict[Place, Instance] = {}
        for row in {places[r.instance][0] for r in post.reports if r.instance in places}:
            before |= self._rows.get(row, {})
        judgements = judge_all(
            post.reports,
            places=places,
            instances=before,
            stored={},
            lease=lease,
            outputs=study.plan.outputs,
            at_work=_nobody_asks,
        )
        after: dict[Place, Instance] = {}
        filed: list[Result] = []
        for judgement in judgements:
            one = judgement.instance
            if judgement.verdict != Verdict.ACCEPTED or judgement.result is None or one is None:
                raise _UnusualError
            if judgement.result.state and NUL in as_text(judgement.result.state):
                # PostgreSQL keeps it in JSON by itself, but not where it takes JSON apart.
                raise _UnusualError
            if before[one.row, one.position].lease != lease.id:
                # Late: somebody else may be about to get it.
                raise _UnusualError
            after[one.row, one.position] = one
            filed.append(judgement.result)
        asked = [
            (lease.host, lease.worker, (result.row, result.position))
            for result in filed
            if is_comparable(result)
            and is_chosen(study.plan.seed, result.row, result.position, post.share)
        ]
        if asked and "@" in study.plan.model:
            # Its description says whether another host would compute the same.
            raise _UnusualError
        # Nothing is unusual from here on.
        self._study = life.with_changes(study, before=before, after=after, filed=filed, now=now)
        for place, one in after.items():
            self._rows[place[0]][place] = one
        self._write_done(lease, before, after)
        self._filed += [(post.worker, result) for result in filed]
        self._asked += asked
        if self._holds(lease):
            self._extended.setdefault(expiry(now, ttl), []).append(lease.id)
        else:
            self._finished.append(lease.id)
        return judgements

    def _write_done(
        self, lease: Lease, before: Mapping[Place, Instance], after: Mapping[Place, Instance]
    ) -> None:
        """Note which instances are done: of a lease that held no other, by the lease."""
        rows = [row for row, _ in after]
        first, last = min([*self._emptied_rows, *rows]), max([*self._emptied_rows, *rows])
        whole = all(before[place].lease == lease.id for place in after) and not self._holds(lease)
        # What is late may be far away, and everything in between would be looked at.
        if whole and last - first <= 4 * (len(self._emptied_rows) + len(rows)):
            self._emptied.append(lease.id)
            self._emptied_rows += rows
        else:
            self._done += after

    def _holds(self, lease: Lease) -> bool:
        """Say whether a lease holds anything now."""
        return any(
            (one := self._rows.get(place[0], {}).get(place)) is not None and one.lease == lease.id
            for place in lease.instances
        )

    def _grant(
        self, request: LeaseRequest, now: float, ttl: float
    ) -> Grant | Ineligible | Deferred | None:
        """Lease instances of the study; Deferred if another transaction must look."""
        study = self._study
        mine = [study_id for study_id, model in self._seen.work if model in request.models]
        opinions = self._seen.opinions
        if opinions.get(request.worker.host) or self._unbound:
            return Deferred()
        if not mine:
            return Deferred() if request.worker.host in opinions else None
        if (
            study is None
            or mine[0] != study.id
            or not study.state.is_served
            or objection_to_worker(study, request.worker) is not None
        ):
            return Deferred()
        kind, most = request.host_class(study.plan.model), request.max_instances
        waiting = self._pending.get(kind, [])
        again = waiting[:most]
        if any(one.avoid is not None for one in again):
            return Deferred()
        wanted = most - len(again) if study.state == StudyState.RUNNING else 0
        begun, fresh = new_rows(study, wanted)
        if not again and not fresh:
            return Deferred() if len(mine) > 1 else None
        self._pending[kind] = waiting[most:]
        lease_id = leasing.new_id(now)
        places = [*((one.row, one.position) for one in again), *begun[:fresh]]
        for place in places[: len(again)]:
            # Of a row that began in this turn nothing is stored yet.
            if place in self._begun:
                self._begun[place] = lease_id, kind
            else:
                self._moved.append((place, lease_id))
        for number, place in enumerate(begun):
            self._begun[place] = (lease_id if number < fresh else None), kind
        # Who asks next in this turn may have the rest of the last row.
        rest = [_waiting(place, kind) for place in begun[fresh:]]
        self._pending.setdefault(kind, []).extend(rest)
        self._study = handed_out(
            study,
            begun=len(begun),
            leased=len(places),
            identity=identity(request.worker.versions),
        )
        grant = leasing.as_granted(self._study, lease_id, request, places, expiry(now, ttl))
        self._granted.append(grant.lease)
        return grant


def _waiting(place: Place, kind: str) -> Instance:
    """Return an instance of a row that has just begun."""
    return Instance(
        row=place[0],
        position=place[1],
        state=InstanceState.PENDING,
        lease=None,
        attempts={},
        host_class=kind,
    )


def _nobody_asks() -> set[str]:
    """Stand for the hosts at work: who needs to know them is judged elsewhere."""
    raise _UnusualError
