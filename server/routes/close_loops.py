"""Closing the loop on sessions and interpreting them: ask for it, follow it, read the report."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import Field
from sqlalchemy.engine import Engine

from analysis.closeloop.code import digest
from analysis.interpretation.contract import MOST_KNOWN
from analysis.interpretation.contract import code as interpreting_code
from server.http.problems import body_of
from server.logic.close_loops import parsed
from server.logic.conditional_requests import tag
from server.operations import close_loops
from server.records import CloseLoopJob
from server.routes.close_loop_leases import FILES_OF
from server.routes.common import (
    BankId,
    Body,
    Id,
    IfNoneMatch,
    Name,
    Now,
    Route,
    Store,
    as_json,
    attachment,
    example,
    not_modified,
)
from server.routes.events import Moment, stream
from server.states import CloseLoopState, JobKind, Outcome

router = APIRouter(prefix="/v1", tags=["close-loops"], route_class=Route)
#: Where the jobs of a kind are.
PLACES = {JobKind.CLOSE_LOOP: "close-loops", JobKind.INTERPRETATION: "interpretations"}

#: Seconds between two looks at the database for the sake of one listener.
EVENT_SECONDS = 0.5
#: A report's page must not speak to the coordinator in its reader's name: no script, no frame, no
#: request, and an origin of its own.
PAGE_POLICY = "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'"
#: What is said of a job that waits while no worker is there for it.
NOTES = {
    JobKind.CLOSE_LOOP: (
        "no worker that can close loops is at work: start `rehyb-worker` without --lifetime on a "
        "machine with 'rehyb[figures]'"
    ),
    JobKind.INTERPRETATION: (
        "no worker with the bank for it is at work: start `rehyb-worker --bank FILE.npz` without "
        "--lifetime on a machine with 'rehyb[figures]'"
    ),
}
MEDIA_TYPES = {
    "report.json": "application/json",
    "report.html": "text/html; charset=utf-8",
    "model_after.xml": "application/xml",
    "residuals.csv": "text/csv; charset=utf-8",
}


class KnownBody(Body):
    """A factor of the bank's population that was measured on the wearer, SI units."""

    model_config = example(name="forearm_length", value=0.31, sd=0.005)

    name: Name
    value: float
    sd: float = Field(gt=0.0)


class InterpretationBody(Body):
    """What is known of a wearer, the half width of K_h that is wanted, and by which bank."""

    model_config = example(
        known=[{"name": "forearm_length", "value": 0.31, "sd": 0.005}], tolerance=0.5, bank=None
    )

    known: list[KnownBody] = Field(default=[], max_length=MOST_KNOWN)
    tolerance: float | None = Field(default=None, gt=0.0)
    bank: BankId | None = None


#: Of a request without a body.
NOTHING_SAID = InterpretationBody()


@router.post("/sessions/{session_id}/close-loop", status_code=202)
def ask(session_id: Id, store: Store, now: Now, response: Response) -> dict[str, Any]:
    """Have a worker close the loop on a session.

    Asking again finds the same job, unless it failed or another version of the code is here now.
    """
    job, _ = close_loops.create(store, session_id, code=digest(), now=now)
    return _asked(job, store, now, response)


@router.post("/sessions/{session_id}/interpretation", status_code=202)
def ask_to_interpret(
    session_id: Id,
    store: Store,
    now: Now,
    response: Response,
    body: InterpretationBody = NOTHING_SAID,
) -> dict[str, Any]:
    """Have a worker with a bank interpret a session of one wearer; the body may be left out.

    Asking the same again finds the same job, unless it failed, or the code or the banks of the
    workers are others now.
    """
    job, _ = close_loops.interpret(
        store, session_id, body.model_dump(), code_of=interpreting_code, now=now
    )
    return _asked(job, store, now, response)


def _asked(job: CloseLoopJob, store: Engine, now: float, response: Response) -> dict[str, Any]:
    response.headers["Location"] = f"/v1/{PLACES[job.kind]}/{job.id}"
    return _standing(job, able=close_loops.able(store, job, now=now))


def _routes(kind: JobKind) -> None:
    """Add what follows a job of a kind and reads its report."""
    place = f"/{PLACES[kind]}/{{job_id}}"

    @router.get(place, response_model=None, name=f"show {kind}")
    def show(job_id: Id, store: Store, now: Now, if_none_match: IfNoneMatch = None) -> Response:
        """Return the report with `id`, `session_id` and `state`; before, how far it is.

        304 if nothing has happened since the answer whose ETag the request names.
        """
        job, able = close_loops.standing(store, job_id, kind=kind, now=now)
        seen = _tag(job, able)
        if known := not_modified(seen, if_none_match):
            return known
        done = job.state == CloseLoopState.DONE
        content = _report(store, job) if done else _standing(job, able=able)
        response = as_json(content)
        response.headers["ETag"] = seen
        return response

    @router.get(f"{place}/events", name=f"events of {kind}")
    async def events(job_id: Id, store: Store, request: Request) -> StreamingResponse:
        """Stream how far a job is as server-sent events, one per change, until it has ended."""

        def look() -> Moment:
            now = request.app.state.clock()
            job, able = close_loops.standing(store, job_id, kind=kind, now=now)
            shown = _standing(job, able=able)
            return Moment(tag=_tag(job, able), content=shown, over=job.state.has_ended)

        return await stream(look, request.app.state.stopping, seconds=EVENT_SECONDS)

    for file in FILES_OF[kind]:
        router.get(f"{place}/{file}")(_reader(kind, file))


def _reader(kind: JobKind, file: str) -> Callable[..., StreamingResponse]:
    def read(job_id: Id, store: Store, now: Now) -> StreamingResponse:
        job, _ = close_loops.standing(store, job_id, kind=kind, now=now)
        size = close_loops.file_size(store, job, file)
        parts = close_loops.read_file(store, job, file, size)
        response = attachment(parts, size, file, MEDIA_TYPES[file])
        response.headers["Content-Security-Policy"] = PAGE_POLICY
        return response

    read.__name__ = file.replace(".", "_")
    read.__doc__ = f"Return {file} of a report, as the command line writes it."
    return read


for _kind in JobKind:
    _routes(_kind)


def _tag(job: CloseLoopJob, able: int) -> str:
    ended = job.state.has_ended
    about = (job.finished_at,) if ended else (job.grants, job.progress, bool(able))
    return tag(job.id, job.state, len(job.attempts), *about, weak=not ended)


def _report(store: Engine, job: CloseLoopJob) -> dict[str, Any]:
    size = close_loops.file_size(store, job, "report.json")
    text = b"".join(close_loops.read_file(store, job, "report.json", size))
    return {**parsed(text), "id": job.id, "session_id": job.session_id, "state": job.state}


def _standing(job: CloseLoopJob, *, able: int) -> dict[str, Any]:
    current = job.current
    shown: dict[str, Any] = {
        "id": job.id,
        **({} if job.options is None else {"options": job.options}),
        "session_id": job.session_id,
        "state": job.state,
        "created_at": job.created_at,
        "finished_at": job.finished_at,
        "progress": job.progress,
        "verdict": job.verdict,
        "worker": None if current is None else current.worker,
        "attempts": [
            {k: value for k, value in asdict(attempt).items() if k not in ("lease", "fence")}
            for attempt in job.attempts
        ],
    }
    if job.state == CloseLoopState.WAITING and not able:
        shown["note"] = NOTES[job.kind]
    if job.fault is not None:
        bad = job.fault["outcome"] == Outcome.BAD_SESSION
        members = {name: job.fault[name] for name in ("outcome", "file", "column", "line")}
        shown["problem"] = body_of(422 if bad else 500, job.fault["detail"], members)
    return shown
