"""How far a study is: asked for, or told as it happens."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.engine import Engine

from server.errors import NotFoundError
from server.logic.caching import is_known, tag
from server.logic.goals import Pursuit
from server.logic.goals import shown as goal_shown
from server.logic.progress import pace
from server.routes.common import Id, Now, Store, clock
from server.store import goals, studies
from server.store.studies import Standing

router = APIRouter(prefix="/v1/studies/{study_id}", tags=["studies"])

#: Seconds between two looks at the database for the sake of one listener.
EVENT_SECONDS = 1.0
#: A line is sent at least this often, so that nothing between takes the connection for dead.
KEEPALIVE_SECONDS = 15.0
#: While nothing happens, rate and remaining time are told anew this often.
STALE_SECONDS = 10.0

IfNoneMatch = Annotated[str | None, Header(examples=['W/"5f2b1c9d8e7a6b5c4d3e"'])]


@router.get("/progress", response_model=None)
def progress(
    study_id: Id, store: Store, now: Now, response: Response, if_none_match: IfNoneMatch = None
) -> dict[str, Any] | Response:
    """Tell how many instances are where, how fast results come, and when they will all be in.

    304 if nothing has happened since the answer whose ETag the request names.
    """
    standing, pursuit = _look(store, study_id, now)
    seen = _tag(standing, pursuit, now)
    if is_known(seen, if_none_match):
        return Response(status_code=304, headers={"ETag": seen})
    response.headers["ETag"] = seen
    return _shown(standing, pursuit, now)


@router.get("/events")
async def events(study_id: Id, store: Store, request: Request) -> StreamingResponse:
    """Stream progress as server-sent events, one per change, until the study has ended."""
    # Asked for before anything is sent, so that a wrong id is a problem and not an empty stream.
    first = await asyncio.to_thread(_look, store, study_id, clock())
    return StreamingResponse(
        _follow(store, study_id, first, request.app.state.stopping),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _follow(
    store: Engine, study_id: str, first: tuple[Standing, Pursuit | None], stopping: asyncio.Event
) -> AsyncIterator[str]:
    told, quiet = "", 0.0
    standing, pursuit = first
    while True:
        now = clock()
        seen = _tag(standing, pursuit, now)
        if seen != told:
            yield f"event: progress\ndata: {json.dumps(_shown(standing, pursuit, now))}\n\n"
            told, quiet = seen, 0.0
        elif quiet >= KEEPALIVE_SECONDS:
            yield ": still here\n\n"
            quiet = 0.0
        study = standing.study
        over = study.state in ("complete", "cancelled")
        # One with a goal may yet be extended.
        if (over and (pursuit is None or pursuit.settled(study))) or stopping.is_set():
            return
        try:
            await asyncio.wait_for(stopping.wait(), EVENT_SECONDS)
        except TimeoutError:
            quiet += EVENT_SECONDS
        try:
            standing, pursuit = await asyncio.to_thread(_look, store, study_id, clock())
        except NotFoundError:
            yield "event: deleted\ndata: {}\n\n"
            return


def _look(store: Engine, study_id: str, now: float) -> tuple[Standing, Pursuit | None]:
    return studies.standing(store, study_id, now=now), goals.of(store, study_id)


def _tag(standing: Standing, pursuit: Pursuit | None, now: float) -> str:
    study = standing.study
    stale = int((now - study.created_at) / STALE_SECONDS) if study.finished_at is None else 0
    return tag(
        study.state,
        study.edition,
        study.result_count,
        study.leased,
        standing.workers,
        stale,
        goal_shown(study, pursuit),
        weak=True,
    )


def _shown(standing: Standing, pursuit: Pursuit | None, now: float) -> dict[str, Any]:
    study = standing.study
    speed = pace(
        study,
        window_opened_at=standing.window_opened_at,
        now=now,
        passed_at=standing.passed_at,
    )
    return {
        "study": study.id,
        "state": study.state,
        "instances": study.plan.instances,
        "pending": study.pending,
        "leased": study.leased,
        "ok": study.ok_count,
        "failed": study.result_count - study.ok_count,
        "failures": dict(study.failures),
        "rows": study.plan.rows,
        "rows_complete": study.rows_complete,
        "results_per_second": speed.results_per_second,
        "eta_seconds": speed.eta_seconds,
        "eta_low_seconds": speed.eta_low_seconds,
        "eta_high_seconds": speed.eta_high_seconds,
        "workers": standing.workers,
        "elapsed_seconds": speed.elapsed_seconds,
        "precision": goal_shown(study, pursuit),
    }
