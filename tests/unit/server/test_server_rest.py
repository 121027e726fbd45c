"""The REST interface: shapes, statuses, problems."""

import csv
import io
import json
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy import event

from analysis.designs import instance_parameters
from analysis.distributions import Uniform
from analysis.service import catch_up
from server.logic.hosts import host_class
from server.store import studies
from server.store.result_log import StoreResultLog
from sim.catalogue import ELBOW

Json = dict[str, Any]

STUDY: Json = {"name": "first", "model": "ishigami", "method": "saltelli", "rows": 2}


@pytest.fixture
def study(client: TestClient) -> Json:
    """A study of two rows of five."""
    response = client.post("/v1/studies", json=STUDY)
    assert response.status_code == 201
    return dict(response.json())


@pytest.fixture
def lease(client: TestClient, study: Json) -> Json:
    """A lease of six instances of the study by worker `w`."""
    response = client.post("/v1/leases", json=_asking(max_instances=6))
    assert response.status_code == 201
    return dict(response.json())


def _asking(**changes: Any) -> Json:
    worker = {"id": "w", "host": "spare-pc", "versions": {"mujoco": "4.0.1"}}
    return {"worker": worker, "models": ["ishigami"], "max_instances": 10, **changes}


def _result(instance: Json, **changes: Any) -> Json:
    return {
        "instance": instance["id"],
        "outcome": "ok",
        "outputs": {"y": 0.5},
        "reason": "",
        "state": None,
        "wall_seconds": 0.125,
        **changes,
    }


def _posting(lease: Json, results: list[Json], **changes: Any) -> Json:
    return {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": results} | (
        changes
    )


def _is_problem(response: Any, status: int) -> Json:
    assert response.status_code == status
    assert response.headers["content-type"] == "application/problem+json"
    problem = dict(response.json())
    assert problem["status"] == status
    assert {"type", "title", "detail"} <= set(problem)
    return problem


def test_a_study_is_created_and_found_again(client: TestClient, clock: Any) -> None:
    response = client.post("/v1/studies", json={**STUDY, "model": "elbow", "method": "morris"})
    assert response.status_code == 201
    study = response.json()
    assert response.headers["location"] == f"/v1/studies/{study['id']}"
    assert study == {
        "id": study["id"],
        "name": "first",
        "model": "elbow",
        "method": "morris",
        "sampling": "sobol",
        "rows": 2,
        "seed": 1,
        "factors": [
            {"name": f.name, "distribution": {"kind": "uniform", "low": f.low, "high": f.high}}
            for f in ELBOW.sampled
        ],
        "fixed": {f.name: f.nominal for f in ELBOW.factors if f.optional},
        "outputs": list(ELBOW.outputs),
        "state": "running",
        "instances": 14,
        "created_at": clock.now,
        "priority": 0,
        "tags": [],
    }
    assert client.get(f"/v1/studies/{study['id']}").json() == study
    assert client.get("/v1/studies").json() == {"studies": [study]}


def test_ranges_distributions_fixed_values_and_outputs_are_taken(client: TestClient) -> None:
    normal = {"kind": "normal", "mean": 0.0, "sd": 1.0}
    body = {
        **STUDY,
        "factors": [{"name": "x3", "distribution": normal}, {"name": "x1", "range": [0, 2.5]}],
        "fixed": {"x2": 1},
        "outputs": ["y"],
        "seed": 2**63 - 1,
        "sampling": "latin_hypercube",
    }
    study = client.post("/v1/studies", json=body).json()
    assert study["factors"] == [
        {"name": "x1", "distribution": {"kind": "uniform", "low": 0.0, "high": 2.5}},
        {"name": "x3", "distribution": normal},
    ]
    assert (study["fixed"], study["seed"]) == ({"x2": 1.0}, 2**63 - 1)


def test_a_discrete_distribution_is_taken(client: TestClient) -> None:
    discrete = {"kind": "discrete", "values": [0.0, 2.0], "probabilities": [0.25, 0.75]}
    body = {**STUDY, "factors": [{"name": "x1", "distribution": discrete}]}
    study = client.post("/v1/studies", json=body).json()
    assert study["factors"] == [{"name": "x1", "distribution": discrete}]


def test_a_repeated_submission_makes_no_second_study(client: TestClient) -> None:
    headers = {"Idempotency-Key": "night run"}
    first = client.post("/v1/studies", json=STUDY, headers=headers)
    again = client.post("/v1/studies", json={**STUDY, "seed": 1}, headers=headers)
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    other = client.post("/v1/studies", json={**STUDY, "rows": 3}, headers=headers)
    assert "'night run' was used for a different study" in _is_problem(other, 409)["detail"]
    assert client.post("/v1/studies", json=STUDY).status_code == 201
    assert client.post("/v1/studies", json=STUDY).status_code == 201
    assert len(client.get("/v1/studies").json()["studies"]) == 3


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"rows": "2"}, "/rows"),
        ({"rows": 2.5}, "/rows"),
        ({"rows": True}, "/rows"),
        ({"name": ""}, "/name"),
        ({"name": "two\nlines"}, "/name"),
        ({"seed": -1}, "/seed"),
        ({"seed": 2**63}, "/seed"),
        ({"factors": [{"name": "x1", "range": [0.0]}]}, "/factors/0/range"),
        ({"factors": [{"name": "x1", "span": [0.0, 1.0]}]}, "/factors/0/span"),
        ({"fixed": {"x1": 10**400}}, "/fixed/x1"),
        ({"surprise": 1}, "/surprise"),
    ],
)
def test_a_malformed_study_is_a_problem_that_points_at_the_fault(
    client: TestClient, changes: Json, pointer: str
) -> None:
    problem = _is_problem(client.post("/v1/studies", json={**STUDY, **changes}), 422)
    assert pointer in [error["pointer"] for error in problem["errors"]]


def test_a_study_that_makes_no_sense_is_a_problem_with_a_pointer(client: TestClient) -> None:
    body = {**STUDY, "factors": [{"name": "x1", "range": [1.0, 0.0]}]}
    problem = _is_problem(client.post("/v1/studies", json=body), 422)
    assert problem["pointer"] == "/factors/0/range"
    assert "low of a uniform distribution must be below high" in problem["detail"]


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_refused(client: TestClient, number: str) -> None:
    text = json.dumps({**STUDY, "fixed": {"x1": 0}}).replace('"x1": 0', f'"x1": {number}')
    response = client.post(
        "/v1/studies", content=text, headers={"Content-Type": "application/json"}
    )
    assert _is_problem(response, 422)["errors"][0]["pointer"] == "/fixed/x1"


def test_a_body_that_is_not_json_is_a_problem(client: TestClient) -> None:
    response = client.post(
        "/v1/studies", content='{"name": ', headers={"Content-Type": "application/json"}
    )
    assert "not JSON" in _is_problem(response, 422)["errors"][0]["detail"]


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/v1/nothing", 404),
        ("GET", "/v1/studies/nothing", 404),
        ("GET", "/v1/studies/nothing/progress", 404),
        ("GET", "/v1/studies/nothing/indices", 404),
        ("GET", "/v1/studies/nothing/results.csv", 404),
        ("POST", "/v1/studies/nothing/cancel", 404),
        ("GET", "/v1/studies/%00", 422),
        ("DELETE", "/v1/studies", 405),
    ],
)
def test_every_refusal_is_a_problem(
    client: TestClient, method: str, path: str, status: int
) -> None:
    _is_problem(client.request(method, path), status)


def test_a_failure_of_the_coordinator_is_a_problem_that_gives_nothing_away(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> None:
        raise RuntimeError("secret inner workings")

    monkeypatch.setattr(studies, "every", fail)
    assert "secret" not in _is_problem(client.get("/v1/studies"), 500)["detail"]


def test_a_lease_says_what_to_evaluate(client: TestClient, study: Json, clock: Any) -> None:
    response = client.post("/v1/leases", json=_asking(max_instances=6))
    assert response.status_code == 201
    lease = response.json()
    assert lease["expires_at"] == clock.now + 60.0
    assert lease["ttl_seconds"] == 60.0
    assert isinstance(lease["fence"], int)
    ranges = {
        f["name"]: Uniform(low=f["distribution"]["low"], high=f["distribution"]["high"])
        for f in study["factors"]
    }
    points = [instance_parameters("saltelli", "sobol", 1, row, ranges) for row in (0, 1)]
    places = [(0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (1, 0)]
    names = [f"{study['id']}:{row}:{position}" for row, position in places]
    assert [i.pop("id") for i in lease["instances"]] == names
    assert lease["instances"] == [
        {
            "study": study["id"],
            "model": "ishigami",
            "row": row,
            "position": position,
            "parameters": points[row][position],
        }
        for row, position in places
    ]


def test_without_work_a_worker_is_told_when_to_ask_again(client: TestClient) -> None:
    response = client.post("/v1/leases", json=_asking())
    assert (response.status_code, response.content) == (204, b"")
    assert int(response.headers["retry-after"]) >= 1


@pytest.mark.parametrize("changes", [{"max_instances": 0}, {"max_instances": 1001}, {"models": []}])
def test_a_greedy_or_empty_request_for_work_is_refused(client: TestClient, changes: Json) -> None:
    _is_problem(client.post("/v1/leases", json=_asking(**changes)), 422)


def test_a_lease_is_renewed_released_and_then_gone(
    client: TestClient, lease: Json, clock: Any
) -> None:
    path, proof = f"/v1/leases/{lease['id']}", {"fence": lease["fence"]}
    clock.advance(30.0)
    assert client.post(f"{path}/renew", json=proof).json() == {
        "expires_at": clock.now + 60.0,
        "ttl_seconds": 60.0,
    }
    _is_problem(client.post(f"{path}/renew", json={"fence": lease["fence"] + 1}), 409)
    assert client.post(f"{path}/release", json=proof).status_code == 200
    assert client.post(f"{path}/release", json=proof).status_code == 200
    assert "released" in _is_problem(client.post(f"{path}/renew", json=proof), 409)["detail"]
    _is_problem(client.post("/v1/leases/nothing/renew", json=proof), 409)


def test_asking_for_work_takes_back_what_expired(
    client: TestClient, lease: Json, clock: Any
) -> None:
    clock.advance(61.0)
    again = client.post("/v1/leases", json=_asking(max_instances=6)).json()
    assert [i["id"] for i in again["instances"]] == [i["id"] for i in lease["instances"]]
    assert again["fence"] > lease["fence"]


def test_good_results_are_accepted(client: TestClient, lease: Json) -> None:
    results = [_result(i) for i in lease["instances"]]
    response = client.post("/v1/results", json=_posting(lease, results))
    assert response.status_code == 200
    assert response.json() == {
        "verdicts": [
            {"instance": i["id"], "verdict": "accepted", "detail": ""} for i in lease["instances"]
        ]
    }
    again = client.post("/v1/results", json=_posting(lease, results))
    assert again.status_code == 200
    assert {v["verdict"] for v in again.json()["verdicts"]} == {"duplicate"}


def test_one_refusal_makes_it_409_but_the_good_ones_are_taken(
    client: TestClient, study: Json, lease: Json
) -> None:
    a, b, c, *_ = lease["instances"]
    text = json.dumps(
        _posting(
            lease,
            [
                _result(a, outputs={"y": float("nan")}),
                _result(b),
                _result({"id": "forged"}),
                _result(c, outputs=None),
            ],
        )
    )
    response = client.post(
        "/v1/results", content=text, headers={"Content-Type": "application/json"}
    )
    assert response.status_code == 409
    verdicts = response.json()["verdicts"]
    assert [v["verdict"] for v in verdicts] == ["invalid", "accepted", "unknown", "invalid"]
    assert all(v["detail"] for v in verdicts if v["verdict"] != "accepted")
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["ok"] == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"results": []},
        {"results": [{"outcome": "ok"}]},
        {"results": "all of them"},
        {"fence": -1},
        {"fence": 2**63},
        {"worker": "w\u0000"},
        {"lease": 5},
    ],
)
def test_a_post_without_shape_is_a_problem(client: TestClient, lease: Json, changes: Json) -> None:
    body = _posting(lease, [_result(lease["instances"][0])])
    _is_problem(client.post("/v1/results", json={**body, **changes}), 422)


def test_progress_adds_up(client: TestClient, study: Json, lease: Json, clock: Any) -> None:
    clock.advance(10.0)
    a, b, c, d, e, _ = lease["instances"]
    results = [_result(i) for i in (a, b, c, d)] + [_result(e, outcome="diverged", outputs={})]
    assert client.post("/v1/results", json=_posting(lease, results)).status_code == 200
    clock.advance(10.0)
    assert client.get(f"/v1/studies/{study['id']}/progress").json() == {
        "study": study["id"],
        "state": "running",
        "instances": 10,
        "pending": 4,
        "leased": 1,
        "ok": 4,
        "failed": 1,
        "failures": {"diverged": 1},
        "rows": 2,
        "rows_complete": 1,
        "results_per_second": 0.25,
        "eta_seconds": 20.0,
        "workers": 1,
        "elapsed_seconds": 20.0,
    }


def test_indices_are_empty_until_the_analysis_has_published(
    client: TestClient, app: FastAPI, study: Json, lease: Json
) -> None:
    path = f"/v1/studies/{study['id']}/indices"
    empty = client.get(path).json()
    assert (empty["study"], empty["cursor"], empty["rows_used"]) == (study["id"], 0, 0)
    results = [_result(i, outputs={"y": float(k)}) for k, i in enumerate(lease["instances"])]
    client.post("/v1/results", json=_posting(lease, results))
    catch_up(StoreResultLog(app.state.engine), study["id"])
    snapshot = client.get(path).json()
    assert (snapshot["cursor"], snapshot["rows_complete"]) == (6, 1)
    assert set(snapshot["outputs"]["y"]["factors"]) == {"x1", "x2", "x3"}


def test_results_are_downloaded_as_a_table(client: TestClient, study: Json, lease: Json) -> None:
    a, b, *_ = lease["instances"]
    results = [_result(b, outcome="diverged", outputs={}), _result(a)]
    client.post("/v1/results", json=_posting(lease, results))
    response = client.get(f"/v1/studies/{study['id']}/results.csv")
    assert response.headers["content-type"] == "text/csv; charset=utf-8"
    first, second = csv.DictReader(io.StringIO(response.text))
    assert {name: float(first[name]) for name in a["parameters"]} == a["parameters"]
    assert (first["row"], first["position"], first["outcome"]) == ("0", "0", "ok")
    assert (first["y"], first["wall_seconds"], first["worker"]) == ("0.5", "0.125", "w")
    assert (second["position"], second["outcome"], second["y"]) == ("1", "diverged", "")


def test_cancelling_stops_the_leasing(client: TestClient, study: Json) -> None:
    response = client.post(f"/v1/studies/{study['id']}/cancel")
    assert (response.status_code, response.json()["state"]) == (200, "cancelled")
    assert client.post("/v1/leases", json=_asking()).status_code == 204


def test_workers_are_listed(client: TestClient, lease: Json, clock: Any) -> None:
    assert client.get("/v1/workers").json() == {
        "workers": [
            {
                "id": "w",
                "host": "spare-pc",
                "versions": {"mujoco": "4.0.1"},
                "last_seen": clock.now,
                "instances_done": 0,
                "host_class": host_class({"mujoco": "4.0.1"}),
                "tags": [],
            }
        ]
    }


def test_a_study_of_millions_is_accepted_at_once(client: TestClient, app: FastAPI) -> None:
    statements: list[str] = []
    event.listen(
        app.state.engine,
        "before_cursor_execute",
        lambda *call: statements.append(str(call[2])),
    )
    response = client.post("/v1/studies", json={**STUDY, "rows": 10_000_000})
    assert response.json()["instances"] == 50_000_000
    assert sum(s.startswith("INSERT") for s in statements) == 1


def test_the_interface_describes_itself(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert {"/v1/studies", "/v1/leases", "/v1/results", "/v1/workers", "/healthz"} <= set(paths)
