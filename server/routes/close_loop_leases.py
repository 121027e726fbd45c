"""Leases of jobs on sessions: workers ask for one, keep it, and hand in what they found."""

import asyncio
import logging
from http import HTTPStatus
from typing import Annotated, Any, BinaryIO, Literal

from fastapi import APIRouter, HTTPException, Query, Request, Response
from pydantic import Field, StringConstraints
from sqlalchemy.engine import Engine
from starlette.datastructures import UploadFile

from analysis.closeloop.contract import REPORT_FILES
from analysis.interpretation.contract import REPORT_FILES as INTERPRETATION_FILES
from server.logic.close_loops import MAX_REPORT_BYTES, PROGRESS_LENGTH, verdict_of
from server.logic.fleet.idling import ask_for_jobs_in
from server.logic.fleet.verdicts import REASON_LENGTH
from server.logic.json_values import cut
from server.operations import close_loops
from server.operations.close_loops import Proof
from server.routes.common import (
    MAX_INTEGER,
    BankId,
    Body,
    Configured,
    Id,
    Name,
    Now,
    Route,
    Store,
    as_json,
    example,
)
from server.routes.fleet.leases import Fence, WorkerBody
from server.routes.uploads import form_of
from server.states import JobKind, Outcome, Verdict

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1/close-loops", tags=["leases"], route_class=Route)

_LEASE = "0f8e4ab7c5d94e2b8a1d6c3f7e9b2a10"

#: What a report of a job consists of.
FILES_OF = {JobKind.CLOSE_LOOP: REPORT_FILES, JobKind.INTERPRETATION: INTERPRETATION_FILES}

Place = Annotated[str, StringConstraints(max_length=2000)] | None


class LoopLeaseBody(Body):
    """Who asks, and the id of the bank that it interprets by, if it does."""

    model_config = example(
        worker={"id": "pc7-4711", "host": "pc7", "versions": {"mujoco": "4.0.1"}, "tags": []},
        bank="f779fd93d326",
    )

    worker: WorkerBody
    bank: BankId | None = None


class LoopFenceBody(Body):
    """Proof that a lease is the bearer's."""

    model_config = example(lease=_LEASE, fence=1)

    lease: Name
    fence: Fence


class LoopRenewalBody(LoopFenceBody):
    """The same, and what the worker is at."""

    model_config = example(lease=_LEASE, fence=1, progress="tracing: effect 1 of at most 3")

    progress: Annotated[str, StringConstraints(max_length=2000)] | None = None


class LoopFailureBody(LoopFenceBody):
    """Why there is no report."""

    model_config = example(
        lease=_LEASE,
        fence=1,
        worker="pc7-4711",
        outcome="crashed",
        reason="the process evaluating it was ended by SIGSEGV",
    )

    worker: Name
    outcome: Literal["bad_session", "crashed", "timed_out"]
    reason: Annotated[str, StringConstraints(max_length=100_000)]
    file: Place = None
    column: Place = None
    line: int | None = Field(default=None, ge=0, le=MAX_INTEGER)


@router.post("/lease", status_code=201, response_model=None)
def lease(body: LoopLeaseBody, store: Store, settings: Configured, now: Now) -> Response:
    """Lease a session to close the loop on or, with a bank, to interpret; 204: nothing to do."""
    close_loops.reap(store, now=now)
    granted = close_loops.grant(
        store, body.worker.introduced(), bank=body.bank, now=now, ttl=settings.lease_seconds
    )
    if granted is None:
        again = ask_for_jobs_in(close_loops.at_work(store, now=now))
        return Response(status_code=204, headers={"Retry-After": str(again)})
    job, session = granted
    attempt = job.attempts[-1]
    about = {"job": job.id, "kind": job.kind, "session": session.id, "worker": attempt.worker}
    log.info("session leased", extra=about)
    answer = {
        "id": job.id,
        "kind": job.kind,
        "options": job.options,
        "lease": attempt.lease,
        "fence": attempt.fence,
        "expires_at": job.expires_at,
        "ttl_seconds": settings.lease_seconds,
        "session": {"id": session.id, "name": session.name, "sha256": session.sha256},
    }
    return as_json(answer, HTTPStatus.CREATED)


@router.post("/{close_loop_id}/renew")
def renew(
    close_loop_id: Id,
    body: LoopRenewalBody,
    request: Request,
    store: Store,
    settings: Configured,
    now: Now,
) -> dict[str, Any]:
    """Keep a job for another ttl, and say what its worker is at."""
    ttl = settings.lease_seconds
    request.app.state.sweep.catch_up()
    progress = None if body.progress is None else cut(body.progress, PROGRESS_LENGTH)
    expires_at = close_loops.renew(
        store,
        close_loop_id,
        lease=body.lease,
        fence=body.fence,
        progress=progress,
        now=now,
        ttl=ttl,
    )
    return {"expires_at": expires_at, "ttl_seconds": ttl}


@router.post("/{close_loop_id}/release")
def release(close_loop_id: Id, body: LoopFenceBody, store: Store) -> dict[str, Any]:
    """Give a job back, unharmed."""
    close_loops.release(store, close_loop_id, lease=body.lease, fence=body.fence)
    return {"released": True}


@router.post("/{close_loop_id}/failure")
def failure(close_loop_id: Id, body: LoopFailureBody, store: Store, now: Now) -> dict[str, Any]:
    """Say why a job has no report; unless the session is at fault it is tried again."""
    place = {
        "file": None if body.file is None else cut(body.file, REASON_LENGTH),
        "column": None if body.column is None else cut(body.column, REASON_LENGTH),
        "line": body.line,
    }
    counted = close_loops.fail(
        store,
        close_loop_id,
        proof=Proof(lease=body.lease, fence=body.fence, worker=body.worker),
        outcome=body.outcome,
        reason=cut(body.reason, REASON_LENGTH),
        where=place,
        now=now,
    )
    return {"verdict": Verdict.ACCEPTED if counted else Verdict.DUPLICATE}


@router.post(
    "/{close_loop_id}/report",
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                "multipart/form-data": {
                    "schema": {
                        "type": "object",
                        "properties": {
                            name: {"type": "string", "format": "binary"} for name in REPORT_FILES
                        },
                        "required": list(INTERPRETATION_FILES),
                        "examples": ["a form with four files; two of an interpretation"],
                    }
                }
            },
        }
    },
)
async def report(
    close_loop_id: Id,
    request: Request,
    store: Store,
    settings: Configured,
    now: Now,
    lease: Annotated[Name, Query(examples=[_LEASE])],
    fence: Annotated[int, Query(ge=0, le=MAX_INTEGER, examples=[1])],
    worker: Annotated[Name, Query(examples=["pc7-4711"])],
    code: Annotated[str, Query(pattern="^[0-9a-f]{16}$", examples=["0123456789abcdef"])],
) -> dict[str, Any]:
    """Hand in a report as a form of its files; the first one that comes is the job's.

    Closing a loop has four, an interpretation the first two.
    """
    proof = Proof(lease=lease, fence=fence, worker=worker)
    # Before anything large is read.
    kind = await asyncio.to_thread(close_loops.require_holder, store, close_loop_id, proof)
    wanted = FILES_OF[kind]
    needs = f"the form must have the files {', '.join(wanted)}"
    told = f"{needs[0].upper()}{needs[1:]}, each once."
    async with form_of(request, told, files=len(wanted)) as form:
        files = {name: form.get(name) for name in wanted}
        if not all(isinstance(file, UploadFile) for file in files.values()):
            raise HTTPException(HTTPStatus.UNPROCESSABLE_ENTITY, needs)
        opened = {n: file.file for n, file in files.items() if isinstance(file, UploadFile)}
        stored = await asyncio.to_thread(
            _hand_in, store, close_loop_id, opened, proof, kind=kind, code=code, now=now
        )
    return {"verdict": Verdict.ACCEPTED if stored else Verdict.DUPLICATE}


def _hand_in(
    store: Engine,
    job_id: str,
    files: dict[str, BinaryIO],
    proof: Proof,
    *,
    kind: JobKind,
    code: str,
    now: float,
) -> bool:
    try:
        verdict = verdict_of(files["report.json"].read(MAX_REPORT_BYTES + 1), kind)
        if empty := [name for name, file in files.items() if file.seek(0, 2) == 0]:
            raise ValueError(f"{empty[0]} is empty")
    except ValueError as error:
        why = str(error)
        close_loops.fail(store, job_id, proof=proof, outcome=Outcome.INVALID, reason=why, now=now)
        raise HTTPException(HTTPStatus.UNPROCESSABLE_ENTITY, why) from None
    for file in files.values():
        file.seek(0)
    return close_loops.hand_in(
        store, job_id, files, proof=proof, code=code, verdict=verdict, now=now
    )
