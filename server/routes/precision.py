"""How precise a study is to become: a goal that is kept with it and pursued without a client."""

from typing import Any

from fastapi import APIRouter

from server.logic.goals import set_goal
from server.routes.common import Id, Store
from server.routes.studies import PrecisionBody, shown
from server.store import goals, studies

router = APIRouter(prefix="/v1/studies/{study_id}/precision", tags=["studies"])


@router.post("")
def aim(study_id: Id, body: PrecisionBody, store: Store) -> dict[str, Any]:
    """Extend a study, whenever it is complete, until it is precise enough or has enough rows."""
    plan = studies.get(store, study_id).plan
    goal = set_goal(plan, output=body.output, target=body.target, up_to=body.up_to)
    goals.put(store, study_id, goal)
    return shown(studies.get(store, study_id), goals.of(store, study_id))


@router.delete("", status_code=204)
def let_be(study_id: Id, store: Store) -> None:
    """Extend a study no more."""
    goals.remove(store, study_id)
