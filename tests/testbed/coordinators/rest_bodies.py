"""Bodies and answers that the tests of the REST interface share."""

from typing import Any

Json = dict[str, Any]

STUDY: Json = {"name": "first", "model": "ishigami", "method": "saltelli", "rows": 2}


def asking(**changes: Any) -> Json:
    worker = {"id": "w", "host": "spare-pc", "versions": {"mujoco": "4.0.1"}}
    return {"worker": worker, "models": ["ishigami"], "max_instances": 10, **changes}


def result(instance: Json, **changes: Any) -> Json:
    return {
        "instance": instance["id"],
        "outcome": "ok",
        "outputs": {"y": 0.5},
        "reason": "",
        "state": None,
        "wall_seconds": 0.125,
        **changes,
    }


def posting(lease: Json, results: list[Json], **changes: Any) -> Json:
    return {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": results} | (
        changes
    )


def is_problem(response: Any, status: int) -> Json:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem = dict(response.json())
    assert problem["status"] == status
    assert {"type", "title", "detail"} <= set(problem)
    return problem


def faults_of(response: Any) -> list[tuple[str, str]]:
    """Return pointer and detail of every fault that a refused request is told."""
    problem = is_problem(response, 422)
    assert ("pointer" in problem) != ("errors" in problem)
    return [(one["pointer"], one["detail"]) for one in problem.get("errors", [problem])]
