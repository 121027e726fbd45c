"""Small studies of functions with known indices, for the tests of the analysis."""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.designs import instance_parameters
from analysis.designs.distributions import Distribution, Uniform, scales
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from rehyb.client import Json
from sim.evaluation import evaluate

Function = Callable[[Mapping[str, float]], Mapping[str, float]]

#: Two outputs of different size, one of them far from zero, with an interaction.
FACTORS: dict[str, Distribution] = {
    "a": Uniform(low=-1.0, high=1.0),
    "b": Uniform(low=0.0, high=2.0),
    "c": Uniform(low=10.0, high=30.0),
}


def two_outputs(x: Mapping[str, float]) -> dict[str, float]:
    """Return outputs that depend on `FACTORS`."""
    return {"y": x["a"] + 2.0 * x["a"] * x["b"] + math.sin(x["c"]), "z": 1e4 + 1e-3 * x["b"] ** 2}


def study_plan(method: str, rows: int, *, sampling: str = "sobol", seed: int = 7) -> StudyPlan:
    """Return the plan of a study of `two_outputs`."""
    return StudyPlan(
        id="study",
        method=method,
        seed=seed,
        sampling=sampling,
        rows=rows,
        factors=tuple(FACTORS),
        outputs=("y", "z"),
        scales=scales(FACTORS),
    )


def results_of(
    plan: StudyPlan,
    function: Function = two_outputs,
    *,
    failed: Sequence[tuple[int, int]] = (),
    outcome: str = "diverged",
    distributions: Mapping[str, Distribution] = FACTORS,
) -> list[LoggedResult]:
    """Evaluate a whole study; `failed` names the (row, position) that end with `outcome`."""
    results: list[LoggedResult] = []
    for row in range(plan.rows):
        points = instance_parameters(plan.method, plan.sampling, plan.seed, row, distributions)
        for position, point in enumerate(points):
            broken = (row, position) in failed
            results.append(
                LoggedResult(
                    seq=len(results) + 1,
                    instance=f"{row}-{position}",
                    row=row,
                    position=position,
                    outcome=outcome if broken else "ok",
                    outputs={} if broken else dict(function(point)),
                )
            )
    return results


def computed_in_one_go(study: Json) -> Json:
    """Return the final snapshot as one process computes it, without fleet, server or database."""
    distributions = {
        factor["name"]: Distribution.from_json(factor["distribution"])
        for factor in study["factors"]
    }
    plan = StudyPlan(
        id=study["id"],
        method=study["method"],
        seed=study["seed"],
        sampling=study["sampling"],
        rows=study["rows"],
        factors=tuple(distributions),
        outputs=tuple(study["outputs"]),
    )

    def outputs(point: Mapping[str, float]) -> Mapping[str, float]:
        return evaluate(study["model"], point).outputs

    return analyse(plan, results_of(plan, outputs, distributions=distributions))


def described(plan: StudyPlan) -> dict[str, Any]:
    """Return the study as a coordinator shows it."""
    return {
        "id": plan.id,
        "name": "a <study> & more",
        "model": "two_outputs",
        "method": plan.method,
        "sampling": plan.sampling,
        "rows": plan.rows,
        "seed": plan.seed,
        "factors": [{"name": name, "distribution": d.to_json()} for name, d in FACTORS.items()],
        "fixed": {"d": 0.5},
        "outputs": list(plan.outputs),
    }


def write_table(path: Path, plan: StudyPlan, results: list[LoggedResult]) -> Path:
    """Write results as a coordinator does."""
    with path.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["row", "position", *FACTORS, "outcome", *plan.outputs, "wall_seconds"])
        for result in results:
            point = instance_parameters(plan.method, plan.sampling, plan.seed, result.row, FACTORS)[
                result.position
            ]
            outputs = [result.outputs.get(name) for name in plan.outputs]
            lines.writerow(
                [result.row, result.position, *point.values(), result.outcome, *outputs, 0.1]
            )
    return path
