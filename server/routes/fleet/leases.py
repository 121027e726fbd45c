"""Leases: ask for work, keep it, give it back."""

import asyncio
import logging
import sqlite3
from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from pydantic import Field, StringConstraints
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import State

from server.errors import ConflictError
from server.http.texts import HIDDEN
from server.logic.fleet.own_models import worth_keeping
from server.operations.fleet import leases
from server.operations.fleet.exchange import Exchange, Grant, Ineligible, LeaseRequest
from server.records import Introduction
from server.routes.common import (
    MAX_INTEGER,
    Body,
    Configured,
    Direct,
    LeaseId,
    Name,
    Now,
    Route,
    Store,
    WorkerId,
    as_json,
    example,
)

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1/leases", tags=["leases"], route_class=Route)

#: What `/readyz` calls what a worker was not given.
LEASE = "lease"

#: One line. All of a worker's are written at each of its requests, and kept for ever.
Reason = Annotated[str, StringConstraints(max_length=300, pattern=r"^[^\x00-\x1f\x7f]*$")]
Fence = Annotated[int, Field(ge=0, le=MAX_INTEGER)]


Most = Annotated[int, Field(ge=1, le=1000)]


class WorkerBody(Body):
    """Who asks."""

    id: WorkerId
    host: Annotated[str, StringConstraints(max_length=255, pattern=f"^[^{HIDDEN}]*$")]
    versions: dict[Name, Name] = Field(default_factory=dict, max_length=50)
    tags: list[Name] = Field(default_factory=list, max_length=20)
    canaries: dict[Name, Name] = Field(
        default_factory=dict,
        max_length=100,
        description="Of models that are not rehyb's own: what this machine computes at a few "
        "points, in a digest.",
    )
    refused: dict[Name, Reason] = Field(
        default_factory=dict,
        max_length=20,
        description="Models that this worker has or should have and does not evaluate, and why.",
    )

    def introduced(self, models: Sequence[str] = ()) -> Introduction:
        """Return who asks, as operations know it.

        Rehyb's own among the models have no canary: which code computes them is told by
        `versions`.
        """
        kept = worth_keeping(tuple(models))
        others = {model: self.canaries.get(model, "") if "@" in model else "" for model in kept}
        return Introduction(
            id=self.id,
            host=self.host,
            versions=self.versions,
            tags=self.tags,
            models=others,
            refused=self.refused,
        )


class LeaseBody(Body):
    """What a worker asks for."""

    model_config = example(
        worker={"id": "pc7-4711", "host": "pc7", "versions": {"mujoco": "4.0.1"}, "tags": []},
        models=["ishigami"],
        max_instances=4,
    )

    worker: WorkerBody
    models: list[Name] = Field(min_length=1, max_length=100)
    max_instances: Most
    at_most: dict[Name, Most] = Field(
        default_factory=dict,
        max_length=100,
        description="Of these models it wants fewer at once, since they take longer.",
    )


class FenceBody(Body):
    """Proof that a lease is the bearer's."""

    model_config = example(fence=17)

    fence: Fence


async def sweep(state: State) -> None:
    """Take back what silent workers hold, if that was not done just before."""
    if state.sweep.is_due():
        state.metrics.lost.inc(await asyncio.to_thread(state.sweep))


async def lease(body: LeaseBody, request: Request) -> Response:
    """Lease instances of one study; 204: nothing to do now; 409: nothing that the worker fits."""
    state, wanted = request.app.state, requested(body)
    now, ttl = state.clock(), state.settings.lease_seconds
    try:
        await sweep(state)
        with state.metrics.lease_seconds.time():
            _, found = await state.exchange(Exchange(request=wanted, now=now, ttl=ttl))
    except (SQLAlchemyError, sqlite3.Error) as error:
        state.readiness.failed(LEASE, error)
        raise
    state.readiness.served(LEASE)
    if isinstance(found, Ineligible):
        state.metrics.misfits.inc()
        raise ConflictError(found.why)
    if found is None:
        pause = state.idle.tell(body.worker.id, now)
        return Response(status_code=204, headers={"Retry-After": str(pause)})
    state.idle.busy(body.worker.id)
    return as_json(granted(found, state), HTTPStatus.CREATED)


router.add_api_route(
    "", lease, methods=["POST"], status_code=201, response_model=None, route_class_override=Direct
)


def requested(body: LeaseBody) -> LeaseRequest:
    """Return what a worker asks for as operations know it."""
    worker = body.worker.introduced(body.models)
    return LeaseRequest(
        worker=worker,
        models=body.models,
        max_instances=body.max_instances,
        at_most=body.at_most,
    )


def granted(grant: Grant, state: State) -> dict[str, Any]:
    """Return a new lease as its worker is told of it."""
    state.metrics.leases.inc()
    if state.traces is not None:
        state.traces.leased(grant.lease)
    lease, count = grant.lease, len(grant.lease.instances)
    about = {"study": lease.study, "lease": lease.id, "worker": lease.worker, "instances": count}
    log.info("lease granted", extra=about)
    return {
        "id": lease.id,
        "fence": lease.fence,
        "expires_at": lease.expires_at,
        "ttl_seconds": state.settings.lease_seconds,
        "instances": grant.instances(),
    }


@router.post("/{lease_id}/renew")
def renew(
    lease_id: LeaseId,
    body: FenceBody,
    request: Request,
    store: Store,
    settings: Configured,
    now: Now,
) -> dict[str, Any]:
    """Keep a lease for another ttl."""
    ttl = settings.lease_seconds
    request.app.state.sweep.catch_up()
    expires_at = leases.renew(store, lease_id, fence=body.fence, now=now, ttl=ttl)
    return {"expires_at": expires_at, "ttl_seconds": ttl}


@router.post("/{lease_id}/release")
def release(lease_id: LeaseId, body: FenceBody, store: Store, now: Now) -> dict[str, Any]:
    """Give back, unharmed, what a lease still holds."""
    leases.release(store, lease_id, fence=body.fence, now=now)
    return {"released": True}
