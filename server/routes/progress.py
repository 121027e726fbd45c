"""How far a study is."""

from typing import Any

from fastapi import APIRouter

from server.logic.progress import pace
from server.routes.common import Id, Now, Store
from server.store import studies

router = APIRouter(prefix="/v1/studies/{study_id}/progress", tags=["studies"])


@router.get("")
def progress(study_id: Id, store: Store, now: Now) -> dict[str, Any]:
    """Tell how many instances are where, how fast results come, and when they will all be in."""
    standing = studies.standing(store, study_id, now=now)
    study = standing.study
    speed = pace(study, window_opened_at=standing.window_opened_at, now=now)
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
        "workers": standing.workers,
        "elapsed_seconds": speed.elapsed_seconds,
    }
