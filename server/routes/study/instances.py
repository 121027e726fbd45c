"""Instances one by one: a listing in pages, and what it takes to replay any of them."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Response

from server.errors import InvalidStudyError
from server.logic.fleet.verdicts import OUTCOME
from server.logic.study.points import instance_id, parameters, point
from server.operations.study import instances
from server.routes.common import MAX_INTEGER, Id, Limit, Route, Store, as_json

router = APIRouter(prefix="/v1/studies/{study_id}/instances", tags=["instances"], route_class=Route)

State = Annotated[
    Literal["pending", "leased", "done", "ok", "failed", "quarantined"] | None,
    Query(
        description="Only these; failed: done, but not ok; quarantined: failed, since too often "
        "it came back without a result.",
        examples=["failed"],
    ),
]
Outcome = Annotated[str | None, Query(pattern=f"^{OUTCOME}$", examples=["slipped"])]
After = Annotated[
    str | None,
    Query(pattern=r"^\d{1,18}:\d{1,9}$", description="`next` of the page before", examples=["7:3"]),
]
Replay = Annotated[
    bool, Query(description="Each with all that it takes to replay it.", examples=[True])
]
Row = Annotated[int, Path(ge=0, le=MAX_INTEGER, examples=[0])]
Position = Annotated[int, Path(ge=0, le=2**31 - 1, examples=[3])]


@router.get("", response_model=dict[str, Any])
def listing(
    study_id: Id,
    store: Store,
    state: State = None,
    outcome: Outcome = None,
    after: After = None,
    limit: Limit = 100,
    replay: Replay = False,
) -> Response:
    """List instances of the rows begun so far, by row and position, a page at a time."""
    row, position = (-1, -1) if after is None else map(int, after.split(":"))
    if position > 2**31 - 1:
        raise InvalidStudyError("/query/after", "no position is that large")
    found = instances.page(
        store, study_id, state=state, outcome=outcome, after=(row, position), limit=limit
    )
    last = found[-1] if len(found) == limit else None
    shown = [
        bundle(study_id, item["row"], item["position"], store) if replay else _line(study_id, item)
        for item in found
    ]
    following = None if last is None else f"{last['row']}:{last['position']}"
    return as_json({"instances": shown, "next": following})


@router.get("/{row}/{position}")
def bundle(study_id: Id, row: Row, position: Position, store: Store) -> dict[str, Any]:
    """Return what it takes to replay an instance: `rehyb assess --replay` reads it."""
    study, known = instances.account(store, study_id, (row, position))
    plan = study.plan
    return {
        "id": instance_id(study_id, row, position),
        "study": study_id,
        "model": plan.model,
        "method": plan.method,
        "sampling": plan.sampling,
        "seed": plan.seed,
        "row": row,
        "position": position,
        **point(plan, row, parameters(plan, row)[position]),
        **known,
    }


def _line(study_id: str, item: Mapping[str, Any]) -> dict[str, Any]:
    line = {name: value for name, value in item.items() if name != "worker_id"}
    return {
        "id": instance_id(study_id, item["row"], item["position"]),
        **line,
        "worker": item["worker_id"],
    }
