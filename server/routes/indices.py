"""A study's sensitivity indices, as the analysis last published them."""

from typing import Any

from fastapi import APIRouter

from analysis.snapshot import empty_snapshot
from server.routes.common import Id, Store
from server.store.result_log import StoreResultLog

router = APIRouter(prefix="/v1/studies/{study_id}/indices", tags=["studies"])


@router.get("")
def indices(study_id: Id, store: Store) -> dict[str, Any]:
    """Return the latest snapshot; an empty one before the analysis has published any."""
    log = StoreResultLog(store)
    plan = log.plan(study_id)
    return log.snapshot(study_id) or empty_snapshot(plan)
