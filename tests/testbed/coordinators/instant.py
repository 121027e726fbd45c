"""A client whose studies are computed on the spot, for tests of campaigns."""

import csv
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from analysis.designs import instance_parameters
from analysis.designs.distributions import Distribution
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from rehyb.errors import Unreachable
from sim.evaluation import evaluate
from sim.models import MODELS
from tests.testbed.studies import results_of


class InstantCoordinator:
    """A client whose studies are computed on the spot."""

    def __init__(self) -> None:
        self.submitted: dict[str, dict[str, Any]] = {}
        self.state = "complete"
        self.away = 0

    def submit(self, study: dict[str, Any], idempotency_key: str) -> dict[str, Any]:
        self._answer()
        self.submitted.setdefault(idempotency_key, dict(study))
        return self._shown(idempotency_key)

    def extend(self, study_id: str, rows: int) -> dict[str, Any]:
        self._answer()
        self.submitted[study_id]["rows"] = rows
        return self._shown(study_id)

    def _shown(self, study_id: str) -> dict[str, Any]:
        study = self.submitted[study_id]
        plan, distributions, _ = evaluated(study_id, study)
        model = MODELS[study["model"]]
        return {
            **study,
            "id": study_id,
            "outputs": list(plan.outputs),
            "factors": [
                {"name": name, "distribution": distribution.to_json()}
                for name, distribution in distributions.items()
            ],
            "fixed": study.get("fixed", {}),
            "units": {f.name: f.unit for f in model.factors} | dict(model.units),
        }

    def progress(self, study_id: str) -> dict[str, Any]:
        self._answer()
        study = self.submitted[study_id]
        return {
            "study": study_id,
            "state": self.state,
            "instances": study["rows"] * 7,
            "rows": study["rows"],
            "workers": 1,
            "failures": {"unstable": 2} if study["method"] == "morris" else {"unstable": 1},
        }

    def indices(self, study_id: str) -> dict[str, Any]:
        self._answer()
        return snapshot(study_id, json.dumps(self.submitted[study_id]))

    def results_csv(self, study_id: str, path: Path) -> None:
        plan, distributions, results = evaluated(study_id, self.submitted[study_id])
        with path.open("w", newline="") as file:
            lines = csv.writer(file)
            lines.writerow(["row", "position", *distributions, "outcome", *plan.outputs])
            for result in results:
                point = instance_parameters(
                    plan.method, plan.sampling, plan.seed, result.row, distributions
                )[result.position]
                values = [result.outputs[name] for name in plan.outputs]
                lines.writerow([result.row, result.position, *point.values(), "ok", *values])

    def _answer(self) -> None:
        if self.away:
            self.away -= 1
            raise Unreachable("no coordinator answers")


def evaluated(
    study_id: str, study: dict[str, Any]
) -> tuple[StudyPlan, dict[str, Distribution], list[LoggedResult]]:
    """Return a study's plan, its factors' distributions, and every result."""
    ranges = {f.name: [f.low, f.high] for f in MODELS[study["model"]].factors}
    ranges = {f["name"]: f["range"] for f in study.get("factors", ())} or ranges
    distributions = {
        name: Distribution.from_json({"kind": "uniform", "low": low, "high": high})
        for name, (low, high) in ranges.items()
    }
    plan = StudyPlan(
        id=study_id,
        method=study["method"],
        seed=study["seed"],
        sampling=study["sampling"],
        rows=study["rows"],
        factors=tuple(distributions),
        outputs=("y",),
    )

    def outputs(point: Mapping[str, float]) -> Mapping[str, float]:
        return evaluate(study["model"], {**point, **study.get("fixed", {})}).outputs

    return plan, distributions, results_of(plan, outputs, distributions=distributions)


@cache
def snapshot(study_id: str, study: str) -> dict[str, Any]:
    """Return the final snapshot of a study, given as JSON."""
    plan, _, results = evaluated(study_id, json.loads(study))
    return analyse(plan, results)
