"""What the coordinator promises of studies and leases, as a model without a database.

It is told what is asked of the coordinator and says what the answer must be. Where the coordinator
may choose (which instances it hands out; whether an instance that came back as often as its budget
allows is given up yet) it is told the choice, and says whether that choice was allowed.
"""

from collections.abc import Collection, Iterable, Mapping
from math import isfinite

from tests.testbed.protocol.records import (
    BUDGETS,
    ENDED,
    RETRIED,
    SERVED,
    Json,
    Lease,
    Place,
    Slot,
    Study,
)


class Protocol:
    """A coordinator's studies and leases.

    Args:
        hosts: those that there are, with their kind of machine.
        ttl: seconds that a lease lasts.
    """

    def __init__(self, hosts: Mapping[str, str], ttl: float) -> None:
        self.hosts = hosts
        self.ttl = ttl
        self.studies: dict[str, Study] = {}
        self.leases: dict[str, Lease] = {}
        self.heard: dict[str, float] = {}
        self.last_fence = 0

    def add(self, answer: Json, *, width: int) -> Study:
        """Take note of a study that was submitted."""
        assert answer["id"] not in self.studies
        study = Study(answer["id"], rows=answer["rows"], width=width)
        self.studies[study.id] = study
        return study

    def grant(self, host: str, most: int, answer: Json, now: float) -> Lease:
        """Take note of a lease; AssertionError if it may not be granted."""
        kind = self.hosts[host]
        self.heard[host] = now
        assert answer["id"] not in self.leases, "the id of a lease was given twice"
        assert answer["fence"] > self.last_fence, "a fence must be larger than all before it"
        self.last_fence = answer["fence"]
        instances = answer["instances"]
        assert 0 < len(instances) <= most
        (study_id,) = {one["study"] for one in instances}
        study = self.studies[study_id]
        places = [(one["row"], one["position"]) for one in instances]
        assert len({*places}) == len(places)
        compares = all(at in study.slots and study.slots[at].result for at in places)
        lease = Lease(
            id=answer["id"],
            fence=answer["fence"],
            study=study_id,
            host=host,
            kind=kind,
            places=places,
            granted=now,
            expires=now + self.ttl,
            compares=compares,
        )
        self.leases[lease.id] = lease
        if compares:
            assert study.state in (*SERVED, "complete")
            return lease
        assert study.state in SERVED, f"a {study.state} study was handed out"
        for row in sorted({row for row, _ in places}):
            self._begin_or_bind(study, row, kind)
        for at in places:
            slot = study.slots[at]
            assert slot.result is None, "a final result was asked for again"
            assert slot.lease is None, "an instance was leased twice"
            slot.lease = lease.id
        return lease

    def _begin_or_bind(self, study: Study, row: int, kind: str) -> None:
        if (row, 0) not in study.slots:
            assert study.state == "running", "a draining study began a row"
            assert row == len(study.slots) // study.width < study.rows, "rows begin in order"
            study.slots |= {(row, position): Slot(kind) for position in range(study.width)}
            return
        for position in range(study.width):
            slot = study.slots[row, position]
            assert slot.kind in (None, kind), "a row was shared by kinds of machines"
            slot.kind = kind

    def refuse(self, host: str, now: float) -> None:
        """Take note that there was nothing for a host; AssertionError if there was."""
        self.heard[host] = now
        kind = self.hosts[host]
        for study in self.studies.values():
            if study.state not in SERVED:
                continue
            fresh = study.state == "running" and len(study.slots) < study.instances
            waits = [
                at
                for at, one in study.slots.items()
                if one.lease is None
                and one.result is None
                and one.kind in (None, kind)
                # Where it went wrong before it need not go again.
                and not one.counts
            ]
            assert not fresh and not waits, f"study {study.id} waits, and {host} got nothing"

    def verdicts(
        self, lease_id: str, fence: int, worker: str, results: Iterable[Json], now: float
    ) -> list[str | None]:
        """Take in results; returns the verdict of each that is due, None where any may be."""
        results = [*results]
        lease = self.leases.get(lease_id)
        if lease is None or lease.study not in self.studies:
            return ["unknown"] * len(results)
        if lease.fence != fence or lease.worker != worker:
            return ["invalid"] * len(results)
        self.heard[lease.host] = now
        if lease.compares:
            # It ends with the last of them; the coordinator is asked which it was.
            return [None] * len(results)
        study = self.studies[lease.study]
        before = len(study.done())
        found: list[str | None] = [self._verdict(study, lease, one) for one in results]
        study.settle(filed=len(study.done()) > before)
        if lease.state == "open":
            if self._holds(lease):
                lease.expires = now + self.ttl
            else:
                lease.state = "finished"
        return found

    def _verdict(self, study: Study, lease: Lease, said: Json) -> str:
        name, row, position = said["instance"].split(":")
        at = (int(row), int(position))
        if name != study.id or at not in lease.places:
            return "unknown"
        slot = study.slots[at]
        held = slot.lease == lease.id
        outcome = said["outcome"]
        y = said["outputs"].get("y") if outcome == "ok" else None
        if outcome in ("lost", "invalid") or (outcome == "ok" and (y is None or not isfinite(y))):
            if held:
                self._come_back(slot, "invalid")
            return "invalid"
        if outcome in RETRIED and not held:
            return "duplicate"
        if slot.result not in (None, ("lost", None)):
            return "duplicate" if slot.result == (outcome, y) else "conflict"
        if not held and slot.taken_back_at > lease.granted:
            return "duplicate"
        if not held and slot.kind != lease.kind:
            return "conflict"
        if outcome in RETRIED:
            self._come_back(slot, outcome)
        else:
            slot.lease, slot.result = None, (outcome, y)
        return "accepted"

    def _come_back(self, slot: Slot, cause: str) -> None:
        """Count an attempt; `given_up` may end the instance."""
        slot.counts[cause] += 1
        slot.lease = None
        if cause in BUDGETS and slot.counts[cause] >= 2 * BUDGETS[cause]:
            slot.result = (cause, None)

    def given_up(self, study_id: str, at: Place, cause: str) -> None:
        """Be told that an instance ended for a cause; AssertionError if it was too soon."""
        study = self.studies[study_id]
        slot = study.slots[at]
        assert slot.result is None and slot.lease is None
        assert slot.counts[cause] >= BUDGETS[cause], f"given up after {slot.counts[cause]} {cause}"
        slot.result = (cause, None)
        study.settle(filed=True)

    def _holds(self, lease: Lease) -> bool:
        slots = self.studies[lease.study].slots
        return any(slots[at].lease == lease.id for at in lease.places)

    def renew(self, lease_id: str, fence: int, now: float) -> bool:
        """Extend a lease; returns whether that is allowed."""
        lease = self.leases.get(lease_id)
        good = (
            lease is not None
            and lease.study in self.studies
            and lease.fence == fence
            and lease.state == "open"
            and lease.expires > now
        )
        if good and lease is not None:
            lease.expires = now + self.ttl
            self.heard[lease.host] = now
        return good

    def release(self, lease_id: str, fence: int, now: float) -> bool:
        """Give back what a lease holds; returns whether that is allowed."""
        lease = self.leases.get(lease_id)
        if lease is None or lease.study not in self.studies or lease.fence != fence:
            return False
        if lease.state == "open":
            lease.state = "released"
            self.heard[lease.host] = now
            self._take_back(lease, cause=None)
        return True

    def reap(self, now: float) -> None:
        """Take back what leases hold that have run out."""
        for lease in self.leases.values():
            if lease.study in self.studies and lease.state == "open" and lease.expires <= now:
                lease.state = "expired"
                silent = self.heard[lease.host] < lease.expires - self.ttl / 2.0
                self._take_back(lease, cause="lost" if silent else "unheard")

    def _take_back(self, lease: Lease, cause: str | None) -> None:
        study = self.studies[lease.study]
        before = len(study.done())
        for at in lease.places:
            slot = study.slots[at]
            if slot.lease == lease.id:
                slot.lease = None
                if cause is not None:
                    self._come_back(slot, cause)
        study.settle(filed=len(study.done()) > before)

    def free_stranded(self, now: float, patience: float) -> None:
        """Begin rows anew that wait for a kind of machine of which nobody was heard."""
        alive = {self.hosts[host] for host, when in self.heard.items() if when > now - patience}
        for study in self.studies.values():
            if study.state not in SERVED:
                continue
            waiting = {
                row
                for (row, _), one in study.slots.items()
                if one.result is None and one.lease is None and one.kind not in (None, *alive)
            }
            held = {row for (row, _), one in study.slots.items() if one.lease is not None}
            for (row, _), slot in study.slots.items():
                if row in waiting - held:
                    slot.reopen(unbound=True, now=now)
            study.recount()

    def restart(self, now: float) -> None:
        """Start the coordinator anew: no open lease has run out meanwhile."""
        for lease in self.leases.values():
            if lease.state == "open":
                lease.expires = now + self.ttl

    def control(self, study_id: str, action: str) -> int:
        """Do what an operator wants; returns the status of the answer."""
        study = self.studies.get(study_id)
        if study is None:
            return 404
        if action == "delete":
            if study.state in SERVED:
                return 409
            del self.studies[study_id]
            return 204
        if action == "cancel":
            if study.state == "complete":
                return 409
            study.state = "cancelled"
            return 200
        if study.state in ENDED:
            return 409
        study.state = {"pause": "paused", "drain": "draining", "resume": "running"}[action]
        study.settle_draining()
        return 200

    def extend(self, study_id: str, rows: int) -> int:
        """Give a study more rows; returns the status of the answer."""
        study = self.studies.get(study_id)
        if study is None:
            return 404
        if study.state == "cancelled" or rows < study.rows:
            return 409
        if rows > study.rows:
            study.rows = rows
            if study.state == "complete":
                study.state = "running"
        return 200

    def rerun(
        self, study_id: str, which: str, outcomes: Collection[str] | None, now: float
    ) -> tuple[int, int | None]:
        """Run results again; returns the status of the answer and how many are taken back."""
        study = self.studies.get(study_id)
        if study is None:
            return 404, None
        if study.state == "cancelled" or (which == "all" and study.held()):
            return 409, None
        done = study.done()
        if which == "failed":
            again = [
                at
                for at, (outcome, _) in done.items()
                if outcome != "ok" and (outcomes is None or outcome in outcomes)
            ]
        else:
            again = [*study.slots]
        for at in again:
            study.slots[at].reopen(unbound=which == "all", now=now)
        study.recount()
        return 200, len([at for at in again if at in done])
