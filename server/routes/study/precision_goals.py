"""Precision goals: kept with a study, which grows until it is precise without any client."""

from typing import Any

from fastapi import APIRouter

from server.logic.study.precision_goals import precision_goal
from server.operations.study import precision_goals, studies
from server.routes.common import Id, Route, Store
from server.routes.study.studies import PrecisionBody, show

router = APIRouter(prefix="/v1/studies/{study_id}/precision", tags=["studies"], route_class=Route)


# As clients know it.
@router.post("", name="aim")
def put(study_id: Id, body: PrecisionBody, store: Store) -> dict[str, Any]:
    """Extend a study, whenever it is complete, until it is precise enough or has enough rows."""
    plan = studies.get(store, study_id).plan
    goal = precision_goal(plan, **body.model_dump())
    precision_goals.put(store, study_id, goal)
    return show(study_id, store)


@router.delete("", status_code=204, name="let_be")
def remove(study_id: Id, store: Store) -> None:
    """Extend a study no more."""
    precision_goals.remove(store, study_id)
