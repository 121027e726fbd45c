"""A coordinator with one finished study, computed on the spot, for tests of files about it."""

import csv
import io
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import httpx2

from analysis.designs import instance_parameters
from analysis.designs.distributions import Distribution, Uniform
from analysis.sensitivity.records import plan_of
from analysis.sensitivity.service import analyse
from rehyb.client import Client, Json
from sim.evaluation import evaluate, identity
from tests.testbed.studies import Function, results_of
from tests.testbed.transport import CoordinatorTransport

RANGES = {name: Uniform(low=-3.0, high=3.0) for name in ("x1", "x2", "x3")}
ROWS, WIDTH = 6, 5
STUDY: dict[str, Any] = {
    "id": "s1",
    "name": "try",
    "model": "ishigami",
    "method": "saltelli",
    "sampling": "sobol",
    "rows": ROWS,
    "seed": 5,
    "factors": [{"name": name, "distribution": d.to_json()} for name, d in RANGES.items()],
    "fixed": {},
    "outputs": ["y"],
    "units": {"x1": "1", "x2": "1", "x3": "1", "y": "1"},
    "state": "complete",
}
UNIT = Uniform(low=0.0, high=1.0).to_json()
#: Of a function of two factors that the test makes up.
OF_TWO = STUDY | {
    "rows": 8,
    "seed": 1,
    "factors": [{"name": name, "distribution": UNIT} for name in ("x1", "x2")],
    "fixed": {"x3": 0.0},
}
#: A place whose run was lost.
LOST = (2, 3)


class FinishedStudy:
    """Answers as a coordinator does whose workers and analysis have done their work.

    Args:
        study: as the coordinator describes it.
        function: the outputs at a point; default: as the study's model computes them.
        lost: (row, position) of runs that were lost.
    """

    def __init__(
        self,
        study: Json = STUDY,
        function: Function | None = None,
        lost: Sequence[tuple[int, int]] = (LOST,),
    ) -> None:
        self.study = study
        self.submitted: list[Any] = []
        self.plan = plan_of(study)
        self.ranges = {
            f["name"]: Distribution.from_json(f["distribution"]) for f in study["factors"]
        }
        self.results = results_of(
            self.plan,
            function or (lambda x: evaluate(study["model"], x).outputs),
            failed=lost,
            outcome="lost",
            distributions=self.ranges,
        )
        self.indices = analyse(self.plan, self.results)
        self.progress: Json = {
            "rows": self.plan.rows,
            "rows_complete": self.indices["rows_complete"],
            "left_by_analysis": 0,
        }

    @cached_property
    def identity(self) -> dict[str, str]:
        """What computed the study."""
        return identity()

    def client(self) -> Client:
        """Return a client of it."""
        return Client("http://c", "t", transport=CoordinatorTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if request.method == "POST":
            self.submitted.append(request.content)
            return httpx2.Response(
                201, json={**self.study, "id": "s2", "instances": len(self.results)}
            )
        if path.endswith("/results.csv"):
            return httpx2.Response(200, text=self.table())
        if path.endswith("/instances"):
            return httpx2.Response(200, json={"instances": self.failures(), "next": None})
        answers = {
            "/v1/studies/s1": self.study,
            "/v1/studies/s1/indices": self.indices,
            "/v1/studies/s1/progress": self.progress,
            "/v1/studies/s1/instances/0/0": {"identity": self.identity},
            "/v1/workers": {
                "workers": [
                    {"id": "pc", "host_class": "c0ffee", "versions": {"numpy": "2"}},
                    {"id": "idle", "host_class": "c0ffee", "versions": {}},
                ]
            },
        }
        return httpx2.Response(200, json=answers[path])

    def table(self) -> str:
        """Return the study's `results.csv`."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        names = self.plan.outputs
        lines.writerow(
            ["row", "position", *self.ranges, "outcome", *names, "wall_seconds", "worker"]
        )
        for one in self.results:
            x = instance_parameters(
                self.plan.method, self.plan.sampling, self.plan.seed, one.row, self.ranges
            )[one.position]
            y = [one.outputs.get(name) for name in names]
            lines.writerow([one.row, one.position, *x.values(), one.outcome, *y, 0.1, "pc"])
        return text.getvalue()

    def failures(self) -> list[dict[str, Any]]:
        """Return the study's failed instances."""
        return [
            {"row": one.row, "position": one.position, "outcome": one.outcome, "reason": "dark"}
            for one in self.results
            if one.outcome != "ok"
        ]


def weighted_sum() -> FinishedStudy:
    """Return a coordinator with the study of y = 3 x1 + x2."""
    return FinishedStudy(OF_TWO, lambda x: {"y": 3.0 * x["x1"] + x["x2"]}, lost=())
