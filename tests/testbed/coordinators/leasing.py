"""Leases of a coordinator's database, as a worker asks for them, and results posted under them."""

from collections.abc import Callable
from typing import Any

from sqlalchemy.engine import Engine

from server.logic.fleet.verdicts import Report, Verdict
from server.logic.study.points import instance_id
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Plan, Study
from tests.testbed.coordinators import exchanges

Drawing = Callable[..., Plan]
Reporting = Callable[..., Report]

TTL = 60.0


def create(engine: Engine, plan: Plan, now: float = 0.0) -> Study:
    """Create a study of a plan."""
    return studies.create(engine, plan, key=None, digest="", now=now)[0]


def lease(
    engine: Engine, *, n: int = 3, now: float = 0.0, worker: str = "w", **changes: Any
) -> Grant | None:
    """Ask for a lease as a worker of the Ishigami function does; None: there is none."""
    asked = {"models": ["ishigami"], "host": "h", "versions": {}, **changes}
    return exchanges.grant(engine, worker=worker, max_instances=n, now=now, ttl=TTL, **asked)


def leased(engine: Engine, **changes: Any) -> Grant:
    """Ask for a lease as `lease` does, and get one."""
    grant = lease(engine, **changes)
    assert grant is not None
    return grant


def post(engine: Engine, grant: Grant, reports: list[Report], now: float = 0.0) -> list[Verdict]:
    """Post reports under a lease and return their verdicts."""
    return exchanges.post(
        engine,
        reports,
        lease_id=grant.lease.id,
        fence=grant.lease.fence,
        worker=grant.lease.worker,
        now=now,
        ttl=TTL,
    )


def ids(grant: Grant) -> list[str]:
    """Return the names of a lease's instances."""
    return [instance_id(grant.study.id, *place) for place in grant.lease.instances]
