"""How far a study is: asked for, or told as it happens."""

from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse

from server.logic.conditional_requests import tag
from server.logic.study.precision_goals import is_settled
from server.logic.study.precision_goals import shown as goal_shown
from server.operations.study import studies
from server.operations.study.studies import Standing
from server.routes.common import Id, IfNoneMatch, Now, Route, RowPatience, Store, not_modified
from server.routes.events import Moment, stream

router = APIRouter(prefix="/v1/studies/{study_id}", tags=["studies"], route_class=Route)

#: Seconds between two looks at the database for the sake of one listener.
EVENT_SECONDS = 1.0
#: While nothing happens, rate and remaining time are told anew this often.
STALE_SECONDS = 10.0


@router.get("/progress", response_model=None)
def progress(
    study_id: Id,
    store: Store,
    now: Now,
    patience: RowPatience,
    response: Response,
    if_none_match: IfNoneMatch = None,
) -> dict[str, Any] | Response:
    """Tell how many instances are where, how fast results come, and when they will all be in.

    304 if nothing has happened since the answer whose ETag the request names.
    """
    standing = studies.standing(store, study_id, now=now, patience=patience)
    seen = _tag(standing, now)
    if known := not_modified(seen, if_none_match):
        return known
    response.headers["ETag"] = seen
    return _shown(standing, now)


@router.get("/events")
async def events(
    study_id: Id, store: Store, patience: RowPatience, request: Request
) -> StreamingResponse:
    """Stream progress as server-sent events, one per change, until the study has ended."""

    def look() -> Moment:
        now = request.app.state.clock()
        standing = studies.standing(store, study_id, now=now, patience=patience)
        study, goal = standing.study, standing.goal
        # One with a goal may yet be extended.
        over = study.state.has_ended and (goal is None or is_settled(study, goal))
        return Moment(tag=_tag(standing, now), content=_shown(standing, now), over=over)

    return await stream(look, request.app.state.stopping, seconds=EVENT_SECONDS)


def _tag(standing: Standing, now: float) -> str:
    study = standing.study
    stale = int((now - study.created_at) / STALE_SECONDS) if study.finished_at is None else 0
    return tag(
        study.state,
        study.edition,
        study.result_count,
        study.leased,
        standing.workers,
        standing.waits_for,
        standing.why_it_waits,
        standing.left_by_analysis,
        stale,
        goal_shown(study, standing.goal),
        weak=True,
    )


def _shown(standing: Standing, now: float) -> dict[str, Any]:
    study, speed = standing.study, standing.pace(now)
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
        "waits_for": standing.waits_for,
        "why_it_waits": standing.why_it_waits,
        "left_by_analysis": standing.left_by_analysis,
        "elapsed_seconds": speed.elapsed_seconds,
        "precision": goal_shown(study, standing.goal),
    }
