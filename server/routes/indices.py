"""A study's sensitivity indices, as the analysis last published them."""

from typing import Any

from fastapi import APIRouter, Response

from analysis.sensitivity.snapshot import empty_snapshot
from server.logic.caching import is_known, tag
from server.logic.study import for_analysis
from server.routes.common import Id, Store
from server.routes.progress import IfNoneMatch
from server.store import studies
from server.store.result_log import StoreResultLog

router = APIRouter(prefix="/v1/studies/{study_id}/indices", tags=["studies"])


@router.get("", response_model=None)
def indices(
    study_id: Id, store: Store, response: Response, if_none_match: IfNoneMatch = None
) -> dict[str, Any] | Response:
    """Return the latest snapshot; an empty one before the analysis has published any.

    304 if it is the one whose ETag the request names.
    """
    study = studies.get(store, study_id)
    snapshot = StoreResultLog(store).snapshot(study_id) or empty_snapshot(for_analysis(study))
    seen = tag(study_id, study.edition, snapshot["rows"], snapshot["cursor"])
    if is_known(seen, if_none_match):
        return Response(status_code=304, headers={"ETag": seen})
    response.headers["ETag"] = seen
    return snapshot
