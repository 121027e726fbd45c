"""Studies: submit, list, show, cancel."""

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, Header, Response
from pydantic import Field, StringConstraints

from server.logic.study import FactorChoice, Study, draw_up
from server.routes.common import MAX_INTEGER, PRINTABLE, Body, Id, Name, Now, Store
from server.store import studies

router = APIRouter(prefix="/v1/studies", tags=["studies"])

Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Title = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=PRINTABLE)]
Key = Annotated[str | None, Header(alias="Idempotency-Key", min_length=1, max_length=255)]


class FactorBody(Body):
    """A factor to sample: over a range, from a distribution, or over the model's own range."""

    name: Name
    range: Range | None = None
    distribution: dict[str, str | float | list[float]] | None = None


class StudyBody(Body):
    """A study to evaluate."""

    name: Title
    model: Name
    method: Name
    rows: int
    factors: list[FactorBody] | None = None
    fixed: dict[str, float] = Field(default_factory=dict)
    seed: int = Field(default=1, ge=0, le=MAX_INTEGER)
    outputs: list[Name] | None = None
    sampling: Name = "sobol"


@router.post("", status_code=201)
def submit(
    body: StudyBody, store: Store, now: Now, response: Response, key: Key = None
) -> dict[str, Any]:
    """Submit a study; the same Idempotency-Key and body return the study already there (200)."""
    plan = draw_up(
        name=body.name,
        model=body.model,
        method=body.method,
        sampling=body.sampling,
        rows=body.rows,
        seed=body.seed,
        factors=None
        if body.factors is None
        else [
            FactorChoice(
                name=factor.name,
                range=None if factor.range is None else (factor.range[0], factor.range[1]),
                distribution=factor.distribution,
            )
            for factor in body.factors
        ],
        fixed=body.fixed,
        outputs=body.outputs,
    )
    digest = hashlib.sha256(body.model_dump_json().encode()).hexdigest()
    study, new = studies.create(store, plan, key=key, digest=digest, now=now)
    response.headers["Location"] = f"/v1/studies/{study.id}"
    response.status_code = 201 if new else 200
    return _shown(study)


@router.get("")
def every(store: Store) -> dict[str, Any]:
    """List all studies, oldest first."""
    return {"studies": [_shown(study) for study in studies.every(store)]}


@router.get("/{study_id}")
def show(study_id: Id, store: Store) -> dict[str, Any]:
    """Show one study."""
    return _shown(studies.get(store, study_id))


@router.post("/{study_id}/cancel")
def cancel(study_id: Id, store: Store, now: Now) -> dict[str, Any]:
    """Hand out no more of a study's instances; results still under way are taken."""
    return _shown(studies.cancel(store, study_id, now=now))


def _shown(study: Study) -> dict[str, Any]:
    plan = study.plan
    return {
        "id": study.id,
        "name": plan.name,
        "model": plan.model,
        "method": plan.method,
        "sampling": plan.sampling,
        "rows": plan.rows,
        "seed": plan.seed,
        "factors": [
            {"name": name, "distribution": distribution.to_json()}
            for name, distribution in plan.distributions.items()
        ],
        "fixed": dict(plan.fixed),
        "outputs": list(plan.outputs),
        "state": study.state,
        "instances": plan.instances,
        "created_at": study.created_at,
    }
