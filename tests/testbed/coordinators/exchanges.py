"""What workers ask of a coordinator's database, each in a transaction of its own."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from sqlalchemy.engine import Engine

from server.errors import ConflictError
from server.logic.fleet.verdicts import Judgement, Report
from server.logic.study.points import instance_id
from server.operations.fleet.exchange import (
    Answer,
    Deferred,
    Exchange,
    Grant,
    Ineligible,
    LeaseRequest,
    Post,
)
from server.operations.fleet.turns import serve_within
from server.records import Introduction, Lease
from server.store.database.engine import writing
from tests.testbed.coordinators.records import report


def asking(worker: str, most: int, **said: Any) -> LeaseRequest:
    """Ask for work of the Ishigami function."""
    host = said.pop("host", "h")
    versions = said.pop("versions", {})
    introduction = Introduction(id=worker, host=host, versions=versions, **said)
    return LeaseRequest(worker=introduction, models=["ishigami"], max_instances=most)


def posting(grant: Grant, how: list[tuple[int, dict[str, Any]]], **said: Any) -> Post:
    """Post results of the instances of a lease at these places, changed so."""
    lease, study = grant.lease, grant.study.id
    about = {"lease": lease.id, "fence": lease.fence, "worker": lease.worker, **said}
    names = [instance_id(study, *place) for place in lease.instances]
    return Post(reports=[report(names[n], **change) for n, change in how], **about)


def serve(engine: Engine, exchange: Exchange) -> Answer:
    """Serve one, alone in as many turns as it takes."""
    with writing(engine) as connection:
        ((judgements, found),) = serve_within(connection, [exchange])
    if isinstance(found, Deferred):
        more, found = serve(engine, found.rest)
        judgements += more
    return judgements, found


def grant(
    engine: Engine,
    *,
    worker: str,
    host: str,
    versions: Mapping[str, str],
    models: Sequence[str],
    max_instances: int,
    now: float,
    ttl: float,
    tags: Sequence[str] = (),
    at_most: Mapping[str, int] = MappingProxyType({}),
) -> Grant | None:
    """Lease instances; None if there is nothing to do.

    Raises:
        ConflictError: there is work, but none for this worker; the message says why.
    """
    request = LeaseRequest(
        worker=Introduction(id=worker, host=host, versions=versions, tags=tags),
        models=models,
        max_instances=max_instances,
        at_most=at_most,
    )
    _, found = serve(engine, Exchange(request=request, now=now, ttl=ttl))
    if isinstance(found, Ineligible):
        raise ConflictError(found.why)
    return found


def post(
    engine: Engine,
    reports: Sequence[Report],
    *,
    lease_id: str,
    fence: int,
    worker: str,
    now: float,
    ttl: float,
    share: float = 0.0,
    tolerance: float = 0.0,
) -> list[Judgement]:
    """Post results; returns a judgement of each."""
    posted = Post(
        reports=reports,
        lease=lease_id,
        fence=fence,
        worker=worker,
        share=share,
        tolerance=tolerance,
    )
    judgements, _ = serve(engine, Exchange(posted=posted, now=now, ttl=ttl))
    return judgements


def hand_in(
    engine: Engine, lease: Lease, reports: Sequence[Report], *, now: float = 0.0
) -> list[str]:
    """Post results under the lease that a worker holds; returns the verdict of each."""
    judged = post(
        engine,
        reports,
        lease_id=lease.id,
        fence=lease.fence,
        worker=lease.worker,
        now=now,
        ttl=60.0,
    )
    return [judgement.verdict for judgement in judged]
