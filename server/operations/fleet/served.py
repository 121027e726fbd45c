"""A study in the course of a turn, while workers are served one after the other.

What workers do nearly always is decided from what the turn has looked at, kept here, and written at
its end. What is rare asks the database, after all that was decided before has been written.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.study.instances import reopened
from server.logic.study.studies import recounted, with_changes, with_found
from server.operations.fleet.exchange import Exchange, Grant, Post, Served
from server.records import Instance, Lease, Place, Result, Study
from server.states import InstanceState
from server.store.fleet.rare import begin_anew, hosts_at_work, put_in_place
from server.store.fleet.turn_changes import Changes
from server.store.fleet.turns import Seen, Turn

# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_DONE = InstanceState.DONE


class ServedStudy:
    """A study in the course of a turn."""

    def __init__(
        self, turn: Turn, study: Study | None, seen: Seen, exchanges: Sequence[Exchange] = ()
    ) -> None:
        self.turn = turn
        #: The one that is locked, as it is now; None if there is none.
        self.study = study
        self.seen = seen
        #: Instances that wait for a machine, by host class, as far as they were asked for.
        self.pending = {host_class: [*found] for host_class, found in seen.pending.items()}
        #: Whether what waits for a machine must be asked for anew.
        self.stale = seen.unbound
        #: What is not written yet; and the study as it is written.
        self.changes = Changes()
        self._written = study
        #: All instances of the rows that the turn is about, as they are now, row by row.
        self._rows: dict[int, dict[Place, Instance]] = {}
        self._others: dict[str, Study | None] = {}
        self._fences: dict[str, int] = {}
        self._now = 0.0
        #: Of the turn, if none of its workers is written yet.
        self._to_come = exchanges
        self.fill(seen.rows)

    def begin(self, now: float) -> None:
        """Serve somebody else, who came at `now`."""
        self._now = max(self._now, now)

    def rows_of(self, posts: Iterable[Post]) -> set[int]:
        """Return the rows in which the leases of posts hold anything."""
        mine = [self.seen.leases.get(post.lease) for post in posts]
        return {
            row
            for lease in mine
            if lease is not None and self.study is not None and lease.study == self.study.id
            for row, _ in lease.instances
        }

    def fill(self, rows: Mapping[Place, Instance]) -> None:
        """Take note of all instances of some rows, which may change."""
        for place, one in rows.items():
            self._rows.setdefault(place[0], {})[place] = one

    def in_rows(self, places: Iterable[Place]) -> dict[Place, Instance]:
        """Return all instances of the rows in which `places` lie, as they are now."""
        found: dict[Place, Instance] = {}
        for row in {row for row, _ in places}:
            found |= self._rows.get(row, {})
        return found

    def note(self, changed: Mapping[Place, Instance]) -> None:
        """Take note of how instances are now."""
        for place, one in changed.items():
            if place[0] in self._rows:
                self._rows[place[0]][place] = one

    def holds(self, lease: Lease) -> bool:
        """Say whether a lease holds any of its instances now."""
        rows = self._rows
        return any(
            (one := rows.get(place[0], {}).get(place)) is not None and one.lease == lease.id
            for place in lease.instances
        )

    async def apply(
        self,
        study: Study,
        lease: Lease,
        *,
        before: Mapping[Place, Instance],
        after: Mapping[Place, Instance],
        filed: Sequence[Result],
    ) -> bool:
        """Take note of how instances now stand that a lease was given.

        Args:
            study: the one that is locked.
            lease: under which a worker brings or loses them.
            before: all instances of the rows concerned as they were.
            after: those that change, as they are now: pending or done.
            filed: the final results, in the order in which they are numbered.

        Returns:
            Whether the lease holds anything any more.
        """
        if not after:
            return self.holds(lease)
        late = {before[place].lease for place in after} != {lease.id}
        if late:
            # Somebody else may have got it in this turn, or be about to.
            self.stale = True
            await self.write()
        self.study = with_changes(study, before=before, after=after, filed=filed, now=self._now)
        self.note(after)
        # What came back waits for a machine.
        self.stale = self.stale or {one.state for one in after.values()} != {_DONE}
        holds = self.holds(lease)
        self.changes.add_outcomes(lease.id, before, after, whole=not (late or holds))
        self.changes.filed += [(lease.worker, result) for result in filed]
        return holds

    async def find(self, lease: Lease, found: Sequence[Result]) -> None:
        """Put results in place of those `lost`, of which it was only said that none had come."""
        assert self.study is not None
        await self.write()
        await put_in_place(self.turn, self.study, lease.worker, found, now=self._now)
        self.study = with_found(self.study, found)

    async def begin_anew(self, study: Study) -> Study:
        """Leave the rows of a study, of which nobody has computed anything, to any host class.

        What was lost with other code may come with this one, and how often it was does not count.

        Returns:
            The study without results.
        """
        await self.write()
        await begin_anew(self.turn, study, now=self._now)
        for row in self._rows.values():
            row.update({place: reopened(one, unbound=True) for place, one in row.items()})
        self.pending, self.stale = {}, True
        if study.result_count:
            study = recounted(study, outcomes={}, rows_complete=0, leased=0)
        self.study = study
        return study

    async def at_work(self, study: Study, host_class: str | None) -> set[str]:
        """Return the hosts of a host class that work on a study."""
        heard_after = self._now - GONE_SECONDS
        return await hosts_at_work(
            self.turn, study, host_class, now=self._now, heard_after=heard_after
        )

    async def other(self, study_id: str) -> Study | None:
        """Return a study, which may be this one or one that is not locked; None if it is gone."""
        if self.study is not None and study_id == self.study.id:
            return self.study
        if study_id not in self._others:
            self._others[study_id] = await self.turn.study(study_id)
        return self._others[study_id]

    async def write(self, *, end: bool = False) -> None:
        """Write what was decided; `end`: and commit."""
        changes, self.changes = self.changes, Changes()
        if not end:
            # All at once, and by name: who comes later could be locked by a turn that waits for
            # those who came before.
            for one in self._to_come:
                if one.posted is not None:
                    changes.company.append(one.posted.worker)
                if one.request is not None:
                    changes.workers.insert(0, (one.request.worker, one.request.host_class(), 0))
            self._to_come = ()
        fences = await self.turn.write(changes, self._written, self.study, now=self._now, end=end)
        self._fences |= fences
        self._written = self.study

    def with_fence(self, answer: Served) -> Served:
        """Return an answer in which a lease that is written has its fence."""
        judgements, found = answer
        if isinstance(found, Grant):
            lease = replace(found.lease, fence=self._fences[found.lease.id])
            found = replace(found, lease=lease)
        return judgements, found
