"""A study's sensitivity indices, as the analysis last published them."""

from fastapi import APIRouter, Response

from analysis.sensitivity.snapshot import empty_snapshot
from server.logic.conditional_requests import tag
from server.logic.study.points import for_analysis
from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.routes.common import Id, IfNoneMatch, Route, Store, as_json, not_modified

router = APIRouter(prefix="/v1/studies/{study_id}/indices", tags=["studies"], route_class=Route)


@router.get("", response_model=None)
def indices(study_id: Id, store: Store, if_none_match: IfNoneMatch = None) -> Response:
    """Return the latest snapshot; an empty one before the analysis has published any.

    304 if it is the one whose ETag the request names.
    """
    study = studies.get(store, study_id)
    snapshot = StoreResultLog(store).snapshot(study_id) or empty_snapshot(for_analysis(study))
    seen = tag(study_id, study.edition, snapshot["rows"], snapshot["cursor"])
    if known := not_modified(seen, if_none_match):
        return known
    return as_json(snapshot, headers={"ETag": seen})
