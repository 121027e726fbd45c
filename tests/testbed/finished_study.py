"""A coordinator with one finished study, computed on the spot, for tests of files about it."""

import csv
import io
from typing import Any

import httpx2

from analysis.designs import instance_parameters
from analysis.designs.distributions import Uniform
from analysis.sensitivity.records import LoggedResult, plan_of
from analysis.sensitivity.service import analyse
from rehyb.client import Client
from sim.evaluation import evaluate, versions
from worker.machine import code

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
    "state": "complete",
}
#: A place whose run was lost.
LOST = (2, 3)


class Coordinator:
    """Answers as a coordinator does whose workers and analysis have done their work."""

    def __init__(self) -> None:
        self.submitted: list[Any] = []
        self.results = self._results()
        self.indices = analyse(plan_of(STUDY), self.results)
        self.identity = {"code": code(), "mujoco": versions()["mujoco"]}

    def client(self) -> Client:
        """Return a client of it."""
        return Client("http://c", "t", transport=httpx2.MockTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if request.method == "POST":
            self.submitted.append(request.content)
            return httpx2.Response(201, json={**STUDY, "id": "s2", "instances": ROWS * WIDTH})
        if path.endswith("/results.csv"):
            return httpx2.Response(200, text=self.table())
        if path.endswith("/instances"):
            return httpx2.Response(200, json={"instances": self.failures(), "next": None})
        answers = {
            "/v1/studies/s1": STUDY,
            "/v1/studies/s1/indices": self.indices,
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
        lines.writerow(["row", "position", *RANGES, "outcome", "y", "wall_seconds", "worker"])
        for one in self.results:
            x = instance_parameters("saltelli", "sobol", 5, one.row, RANGES)[one.position]
            y = one.outputs.get("y")
            lines.writerow([one.row, one.position, *x.values(), one.outcome, y, 0.1, "pc"])
        return text.getvalue()

    def failures(self) -> list[dict[str, Any]]:
        """Return the study's failed instances."""
        return [
            {"row": one.row, "position": one.position, "outcome": one.outcome, "reason": "dark"}
            for one in self.results
            if one.outcome != "ok"
        ]

    def _results(self) -> list[LoggedResult]:
        found = []
        for row in range(ROWS):
            points = instance_parameters("saltelli", "sobol", 5, row, RANGES)
            for position, x in enumerate(points):
                lost = (row, position) == LOST
                found.append(
                    LoggedResult(
                        seq=len(found) + 1,
                        instance="",
                        row=row,
                        position=position,
                        outcome="lost" if lost else "ok",
                        outputs={} if lost else dict(evaluate("ishigami", x).outputs),
                    )
                )
        return found
