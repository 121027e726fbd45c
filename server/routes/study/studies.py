"""Studies: submit, list, show, and what an operator does with one under way."""

import hashlib
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field, WithJsonSchema, model_validator
from sqlalchemy.engine import Engine

from analysis.designs import DEFAULT_SAMPLING
from models.curves import names_of
from server.logic.study.plans import FactorChoice, draw_up, refuse_outside_range
from server.logic.study.points import parameters
from server.logic.study.precision_goals import precision_goal
from server.logic.study.precision_goals import shown as goal_shown
from server.logic.study.requests import refuse_dependence, refuse_too_few, refuse_too_much
from server.operations import models
from server.operations.study import precision_goals, reruns, studies
from server.records import PrecisionGoal, Study
from server.routes.common import (
    MAX_INTEGER,
    Body,
    Id,
    Limit,
    Name,
    Now,
    Route,
    Store,
    as_json,
    example,
    no_key_twice,
)
from server.routes.study.fields import After, Entry, Key, Priority, Range, Tags, Title, Value
from server.states import StudyState

router = APIRouter(
    prefix="/v1/studies", tags=["studies"], dependencies=[Depends(no_key_twice)], route_class=Route
)

#: Of a study that is submitted, what its plan is drawn up from, besides model and factors.
_OF_PLAN = {
    "correlations",
    "correlation_kind",
    "name",
    "method",
    "sampling",
    "rows",
    "seed",
    "fixed",
    "outputs",
    "groups",
}


class FactorBody(Body):
    """A factor to sample: over a range, from a distribution, or over the model's own range."""

    name: Name
    range: Range | None = None
    distribution: dict[str, Entry] | None = None


#: Two factors and their correlation, as ["a", "b", 0.6].
Correlation = Annotated[
    list[Any],
    WithJsonSchema(
        {
            "type": "array",
            "items": {"anyOf": [{"type": "string"}, {"type": "number"}]},
            "minItems": 3,
            "maxItems": 3,
        }
    ),
]


class PrecisionBody(Body):
    """Half width wanted of every interval of one output, and the rows that it may cost in all."""

    model_config = example(output="stiffness_error", target=0.05, up_to=4096)

    output: Name | None = None
    target: float | None = None
    up_to: int


class StudyBody(Body):
    """A study to evaluate."""

    model_config = example(
        name="masses",
        model="ishigami",
        method="saltelli",
        rows=16,
        factors=[{"name": "x1"}, {"name": "x2", "range": [0.0, 1.0]}],
        seed=1,
    )

    name: Title
    model: Name
    method: Name
    rows: int
    factors: list[FactorBody] | None = None
    fixed: dict[str, Value] = Field(default_factory=dict)
    seed: int = Field(default=1, ge=0, le=MAX_INTEGER)
    outputs: list[Name] | None = None
    groups: dict[Name, list[Name]] = Field(default_factory=dict)
    sampling: Name = DEFAULT_SAMPLING
    priority: Priority = 0
    tags: Tags = Field(default_factory=list)
    precision: PrecisionBody | None = None
    #: Whether values may lie far outside the ranges for which the model was validated.
    outside_range: bool = False
    #: Of pairs of factors; all others are independent.
    correlations: list[Correlation] = Field(default_factory=list, max_length=10_000)
    correlation_kind: Name = "rank"

    @model_validator(mode="before")
    @classmethod
    def _refused_as_a_whole(cls, body: Any) -> Any:
        refuse_too_much(body)
        # Else they would only be told that the key is unknown.
        refuse_dependence(body)
        return body


class ExtensionBody(Body):
    """How many rows a study is to have in all."""

    model_config = example(rows=32)

    rows: int


class PriorityBody(Body):
    """How urgent a study is."""

    model_config = example(priority=5)

    priority: Priority


class RerunBody(Body):
    """What is to run again."""

    model_config = example(which="failed", outcomes=["lost", "crashed"])

    which: Literal["failed", "all"] = "failed"
    outcomes: list[Name] | None = Field(default=None, min_length=1, max_length=100)

    @model_validator(mode="after")
    def _outcomes_are_of_failures(self) -> Self:
        if self.which == "all" and self.outcomes:
            raise ValueError("all takes back every result: leave out outcomes, or say failed")
        return self


@router.post("", status_code=201)
def submit(
    body: StudyBody, request: Request, store: Store, now: Now, response: Response, key: Key = None
) -> dict[str, Any]:
    """Submit a study; the same Idempotency-Key and body return the study already there (200)."""
    factors, sampled = body.factors, models.to_sample(store, body.model)
    plan = draw_up(
        **body.model_dump(include=_OF_PLAN),
        model=sampled.description,
        called=sampled.called,
        factors=None if factors is None else [FactorChoice(**dict(factor)) for factor in factors],
    )
    refuse_too_few(plan)
    if not body.outside_range:
        refuse_outside_range(plan, sampled.description, [f.name for f in factors or ()])
    wanted = body.precision
    goal = None
    if wanted is not None:
        goal = precision_goal(plan, **wanted.model_dump(), pointer="/precision")
    # Who may compute it, how soon and how far it may grow makes no other study of it.
    left_out = {"priority", "tags", "precision", "outside_range"}
    # Without them it is what it was before there were any.
    left_out |= set() if body.correlations else {"correlations", "correlation_kind"}
    left_out |= set() if body.groups else {"groups"}
    what = body.model_dump_json(exclude=left_out)
    # Here a thread waits for what that may have to import, at the first lease the event loop.
    parameters(plan, 0)
    study, new = studies.create(
        store,
        plan,
        key=key,
        digest=hashlib.sha256(what.encode()).hexdigest(),
        now=now,
        priority=body.priority,
        tags=body.tags,
        goal=goal,
    )
    if new and (traces := request.app.state.traces) is not None:
        traces.submitted(study)
    response.headers["Location"] = f"/v1/studies/{study.id}"
    response.status_code = 201 if new else 200
    return _show(store, study)


@router.get("", response_model=dict[str, Any])
def listing(store: Store, after: After = None, limit: Limit = 1000) -> Response:
    """List studies in short, oldest first, a page at a time."""
    made, _, last_id = (after or "").partition(":")
    seen = None if after is None else (float(made), last_id)
    found = studies.listed(store, after=seen, limit=limit)
    last = found[-1] if len(found) == limit else None
    following = None if last is None else f"{last['created_at']!r}:{last['id']}"
    return as_json({"studies": found, "next": following})


@router.get("/{study_id}")
def show(study_id: Id, store: Store) -> dict[str, Any]:
    """Show one study."""
    return _show(store, studies.get(store, study_id))


@router.post("/{study_id}/cancel")
def cancel(study_id: Id, store: Store, now: Now) -> dict[str, Any]:
    """Hand out no more of a study's instances; results still under way are taken."""
    return _show(store, studies.cancel(store, study_id, now=now))


@router.post("/{study_id}/pause")
def pause(study_id: Id, store: Store) -> dict[str, Any]:
    """Hand out nothing of a study for a while; results under way are taken."""
    return _show(store, studies.switch(store, study_id, StudyState.PAUSED))


@router.post("/{study_id}/drain")
def drain(study_id: Id, store: Store) -> dict[str, Any]:
    """Finish the rows that were begun and begin no other; then the study is paused."""
    return _show(store, studies.switch(store, study_id, StudyState.DRAINING))


@router.post("/{study_id}/resume")
def resume(study_id: Id, store: Store) -> dict[str, Any]:
    """Go on with a paused or draining study."""
    return _show(store, studies.switch(store, study_id, StudyState.RUNNING))


@router.post("/{study_id}/extend")
def extend(study_id: Id, body: ExtensionBody, store: Store) -> dict[str, Any]:
    """Give a study more rows; what there is of it stays, and a complete one runs again."""
    return _show(store, studies.extend(store, study_id, body.rows))


@router.post("/{study_id}/priority")
def prioritise(study_id: Id, body: PriorityBody, store: Store) -> dict[str, Any]:
    """Serve a study before all of lower priority."""
    return _show(store, studies.prioritise(store, study_id, body.priority))


@router.post("/{study_id}/rerun")
def rerun(study_id: Id, body: RerunBody, store: Store, now: Now) -> dict[str, Any]:
    """Run the failed instances again, or all; what is replaced is kept aside as evidence."""
    study, taken_back = reruns.rerun(
        store, study_id, which=body.which, outcomes=body.outcomes, now=now
    )
    return {**_show(store, study), "taken_back": taken_back}


@router.delete("/{study_id}", status_code=204)
def delete(study_id: Id, store: Store) -> None:
    """Remove a study that does not run, with its results and indices."""
    studies.delete(store, study_id)


def _show(store: Engine, study: Study) -> dict[str, Any]:
    """Return a study with its goal, and the units of its factors and outputs."""
    model = models.get(store, study.plan.model).description
    kept = set(shown(study, None)["outputs"])
    outputs = {output.name: output.unit for output in model.results if output.name in kept}
    outputs |= {name: unit for name, unit in model.units.items() if name in kept}
    units = {source.name: source.unit for source in model.sources} | outputs
    return {**shown(study, precision_goals.of(store, study.id)), "units": units}


def shown(study: Study, goal: PrecisionGoal | None) -> dict[str, Any]:
    """Return a study as the interface shows it, with its goal if it has one."""
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
        "correlations": [list(pair) for pair in plan.dependence.pairs] if plan.dependence else [],
        "correlation_kind": plan.dependence.kind if plan.dependence else "rank",
        "fixed": dict(plan.fixed),
        "outputs": names_of(plan.outputs, plan.curves),
        "groups": {name: list(members) for name, members in plan.groups.items()},
        "curves": {name: curve.as_json() for name, curve in plan.curves.items()},
        "state": study.state,
        "instances": plan.instances,
        "created_at": study.created_at,
        "priority": study.priority,
        "tags": list(study.tags),
        "precision": goal_shown(study, goal),
    }
