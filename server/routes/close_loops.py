"""Closing the loop on sessions: ask for it, follow it, read what was found."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.engine import Engine

from analysis.closeloop.code import digest
from analysis.closeloop.contract import REPORT_FILES
from server.logic.caching import tag
from server.logic.close_loops import parsed
from server.operations import close_loops
from server.problems import body_of
from server.records import CloseLoopJob
from server.routes.common import Id, IfNoneMatch, Now, Store, as_json, not_modified
from server.routes.events import Moment, stream
from server.states import CloseLoopState, Outcome

router = APIRouter(prefix="/v1", tags=["close-loops"])

#: Seconds between two looks at the database for the sake of one listener.
EVENT_SECONDS = 0.5
#: A report's page must not speak to the coordinator in its reader's name: no script, no frame, no
#: request, and an origin of its own.
PAGE_POLICY = "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'"
MEDIA_TYPES = {
    "report.json": "application/json",
    "report.html": "text/html; charset=utf-8",
    "model_after.xml": "application/xml",
    "residuals.csv": "text/csv; charset=utf-8",
}


@router.post("/sessions/{session_id}/close-loop", status_code=202)
def ask(session_id: Id, store: Store, now: Now, response: Response) -> dict[str, Any]:
    """Have a worker close the loop on a session.

    Asking again finds the same job, unless it failed or another version of the code is here now.
    """
    job, _ = close_loops.create(store, session_id, code=digest(), now=now)
    response.headers["Location"] = f"/v1/close-loops/{job.id}"
    return _standing(job, able=close_loops.at_work(store, now=now))


@router.get("/close-loops/{close_loop_id}", response_model=None)
def show(close_loop_id: Id, store: Store, now: Now, if_none_match: IfNoneMatch = None) -> Response:
    """Return the report with `id`, `session_id` and `state`; before it is there, how far it is.

    304 if nothing has happened since the answer whose ETag the request names.
    """
    job, able = close_loops.standing(store, close_loop_id, now=now)
    seen = _tag(job, able)
    if known := not_modified(seen, if_none_match):
        return known
    done = job.state == CloseLoopState.DONE
    content = _report(store, job) if done else _standing(job, able=able)
    response = as_json(content)
    response.headers["ETag"] = seen
    return response


@router.get("/close-loops/{close_loop_id}/events")
async def events(close_loop_id: Id, store: Store, request: Request) -> StreamingResponse:
    """Stream how far a job is as server-sent events, one per change, until it is done or failed."""

    def look() -> Moment:
        job, able = close_loops.standing(store, close_loop_id, now=request.app.state.clock())
        shown = _standing(job, able=able)
        return Moment(tag=_tag(job, able), content=shown, over=job.state.has_ended)

    return await stream(look, request.app.state.stopping, seconds=EVENT_SECONDS)


def _reader(file: str) -> Callable[..., StreamingResponse]:
    def read(close_loop_id: Id, store: Store) -> StreamingResponse:
        job = close_loops.get(store, close_loop_id)
        size = close_loops.file_size(store, job, file)
        return StreamingResponse(
            close_loops.read_file(store, job, file, size),
            media_type=MEDIA_TYPES[file],
            headers={
                "Content-Length": str(size),
                "Content-Disposition": f'attachment; filename="{file}"',
                "Content-Security-Policy": PAGE_POLICY,
                "X-Content-Type-Options": "nosniff",
            },
        )

    read.__name__ = file.replace(".", "_")
    read.__doc__ = f"Return {file} of a report, as the command line writes it."
    return read


for _file in REPORT_FILES:
    router.get(f"/close-loops/{{close_loop_id}}/{_file}")(_reader(_file))


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
        shown["note"] = (
            "no worker that can close loops is at work: start `rehyb-worker` on a machine with "
            "'rehyb[figures]'"
        )
    if job.fault is not None:
        bad = job.fault["outcome"] == Outcome.BAD_SESSION
        members = {name: job.fault[name] for name in ("outcome", "file", "column", "line")}
        shown["problem"] = body_of(422 if bad else 500, job.fault["detail"], members)
    return shown
