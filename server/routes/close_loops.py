"""Closing the loop on sessions: ask for it, follow it, read what was found."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.engine import Engine

from analysis.closeloop.code import digest
from server.errors import NotFoundError
from server.logic.caching import is_known, tag
from server.logic.close_loops import BAD_SESSION, FILES, CloseLoop, parsed
from server.problems import body_of
from server.routes.common import Id, Now, Store, as_json, clock
from server.store import close_loops, loop_workers

router = APIRouter(prefix="/v1", tags=["close-loops"])

#: Seconds between two looks at the database for the sake of one listener.
EVENT_SECONDS = 0.5
#: A line is sent at least this often, so that nothing between takes the connection for dead.
KEEPALIVE_SECONDS = 15.0
#: A report's page must not speak to the coordinator in its reader's name: no script, no frame, no
#: request, and an origin of its own.
PAGE_POLICY = "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'"
MEDIA_TYPES = {
    "report.json": "application/json",
    "report.html": "text/html; charset=utf-8",
    "model_after.xml": "application/xml",
    "residuals.csv": "text/csv; charset=utf-8",
}

IfNoneMatch = Annotated[str | None, Header(examples=['W/"5f2b1c9d8e7a6b5c4d3e"'])]


@router.post("/sessions/{session_id}/close-loop", status_code=202)
def ask(session_id: Id, store: Store, now: Now, response: Response) -> dict[str, Any]:
    """Have a worker close the loop on a session.

    Asking again finds the same job, unless it failed or another version of the code is here now.
    """
    job, _ = close_loops.create(store, session_id, code=digest(), now=now)
    response.headers["Location"] = f"/v1/close-loops/{job.id}"
    return _standing(job, able=loop_workers.at_work(store, now=now))


@router.get("/close-loops/{close_loop_id}", response_model=None)
def show(close_loop_id: Id, store: Store, now: Now, if_none_match: IfNoneMatch = None) -> Response:
    """Return the report with `id`, `session_id` and `state`; before it is there, how far it is.

    304 if nothing has happened since the answer whose ETag the request names.
    """
    job = close_loops.get(store, close_loop_id)
    able = loop_workers.at_work(store, now=now)
    seen = _tag(job, able)
    if is_known(seen, if_none_match):
        return Response(status_code=304, headers={"ETag": seen})
    content = _report(store, job) if job.state == "done" else _standing(job, able=able)
    response = as_json(content)
    response.headers["ETag"] = seen
    return response


@router.get("/close-loops/{close_loop_id}/events")
async def events(close_loop_id: Id, store: Store, request: Request) -> StreamingResponse:
    """Stream how far a job is as server-sent events, one per change, until it is done or failed."""
    # Asked for before anything is sent, so that a wrong id is a problem and not an empty stream.
    await asyncio.to_thread(close_loops.get, store, close_loop_id)
    return StreamingResponse(
        _follow(store, close_loop_id, request.app.state.stopping),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


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


for _file in FILES:
    router.get(f"/close-loops/{{close_loop_id}}/{_file}")(_reader(_file))


async def _follow(store: Engine, job_id: str, stopping: asyncio.Event) -> AsyncIterator[str]:
    told, quiet = "", 0.0
    while True:
        try:
            job = await asyncio.to_thread(close_loops.get, store, job_id)
        except NotFoundError:
            yield "event: deleted\ndata: {}\n\n"
            return
        able = await asyncio.to_thread(loop_workers.at_work, store, now=clock())
        if (seen := _tag(job, able)) != told:
            yield f"event: progress\ndata: {json.dumps(_standing(job, able=able))}\n\n"
            told, quiet = seen, 0.0
        elif quiet >= KEEPALIVE_SECONDS:
            yield ": still here\n\n"
            quiet = 0.0
        if job.state in ("done", "failed") or stopping.is_set():
            return
        try:
            await asyncio.wait_for(stopping.wait(), EVENT_SECONDS)
        except TimeoutError:
            quiet += EVENT_SECONDS


def _tag(job: CloseLoop, able: int) -> str:
    ended = job.state in ("done", "failed")
    about = (job.finished_at,) if ended else (job.grants, job.progress, bool(able))
    return tag(job.id, job.state, len(job.attempts), *about, weak=not ended)


def _report(store: Engine, job: CloseLoop) -> dict[str, Any]:
    size = close_loops.file_size(store, job, "report.json")
    text = b"".join(close_loops.read_file(store, job, "report.json", size))
    return {**parsed(text), "id": job.id, "session_id": job.session_id, "state": job.state}


def _standing(job: CloseLoop, *, able: int) -> dict[str, Any]:
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
            {
                "worker": attempt.worker,
                "host": attempt.host,
                "granted_at": attempt.granted_at,
                "ended": attempt.ended,
                "reason": attempt.reason,
            }
            for attempt in job.attempts
        ],
    }
    if job.state == "waiting" and not able:
        shown["note"] = (
            "no worker that can close loops is at work: start `rehyb-worker` on a machine with "
            "'rehyb[figures]'"
        )
    if job.fault is not None:
        bad = job.fault["outcome"] == BAD_SESSION
        members = {name: job.fault[name] for name in ("outcome", "file", "column", "line")}
        shown["problem"] = body_of(422 if bad else 500, job.fault["detail"], members)
    return shown
