"""What follows from a study's plan: its points, their names, and what the analysis is told."""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from analysis.designs import instance_parameters
from analysis.designs.distributions import scales
from analysis.sensitivity.records import StudyPlan, normals
from models.factors import SEED
from server.records import Place, Plan, Study


def instance_id(study_id: str, row: int, position: int) -> str:
    """Name an instance so that a reader can replay it: study, row and position in the row."""
    return f"{study_id}:{row}:{position}"


def parameters(plan: Plan, row: int) -> list[dict[str, float]]:
    """Return every factor's value for every instance of a row, in position order (SI units)."""
    points = instance_parameters(
        plan.method,
        plan.sampling,
        plan.seed,
        row,
        plan.distributions,
        plan.correlation,
        plan.groups,
    )
    return [{**plan.fixed, **point} for point in points]


def point(plan: Plan, row: int, values: Mapping[str, float]) -> dict[str, Any]:
    """Return what a model is asked at one of a row's points: its parameters, and a seed.

    All of a row have the same seed, so that what differs between them is what their parameters do;
    where the seed is sampled, too, it is another wherever its value is another.
    """
    value = values.get(SEED.name, 0.0)
    if SEED.name in plan.fixed:
        seed = int(value)
    else:
        said = f"{plan.seed}:{row}:{value!r}".encode()
        seed = int.from_bytes(hashlib.blake2b(said, digest_size=4).digest(), "big")
    return {
        "parameters": {name: x for name, x in values.items() if name != SEED.name},
        "model_seed": seed,
    }


def told(study: Study, places: Sequence[Place]) -> list[dict[str, Any]]:
    """Return instances as a worker is told of them, with their parameters, which no table holds."""
    plan = study.plan
    rows = {row: parameters(plan, row) for row in {row for row, _ in places}}
    # What a worker gives as lists, and what it leaves out unless it is asked.
    curves = {"curves": {name: c.as_json() for name, c in plan.curves.items()}}
    return [
        {
            "id": instance_id(study.id, row, position),
            "study": study.id,
            "model": plan.model,
            "row": row,
            "position": position,
            **point(plan, row, rows[row][position]),
            **(curves if plan.curves else {}),
        }
        for row, position in places
    ]


def for_analysis(study: Study) -> StudyPlan:
    """Return what the analysis needs to know of a study."""
    return StudyPlan(
        id=study.id,
        method=study.plan.method,
        seed=study.plan.seed,
        sampling=study.plan.sampling,
        rows=study.plan.rows,
        factors=tuple(study.plan.distributions),
        outputs=study.plan.outputs,
        curves=study.plan.curves,
        groups=study.plan.groups,
        scales=scales(study.plan.distributions),
        normal=normals(study.plan.distributions),
    )
