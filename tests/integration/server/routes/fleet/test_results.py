"""Work, results and progress over REST: shapes, statuses, problems."""

import csv
import io
import json
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pyarrow import parquet
from sqlalchemy import event
from sqlalchemy.engine import Engine

from analysis.designs import DEFAULT_SAMPLING, instance_parameters
from analysis.designs.distributions import Uniform
from analysis.files.parquet import STUDY_KEY
from analysis.sensitivity.service import catch_up
from server.logic.fleet.hosts import host_class
from server.logic.study.progress import UNSEEN_SECONDS
from server.operations.fleet import leases
from server.operations.study.result_log import StoreResultLog
from tests.testbed.coordinators.rest_bodies import (
    STUDY,
    Json,
    asking,
    faults_of,
    is_problem,
    posting,
    result,
)

JSON = {"Content-Type": "application/json"}


@pytest.fixture
def study(client: TestClient) -> Json:
    """A study of two rows of five."""
    response = client.post("/v1/studies", json=STUDY)
    assert response.status_code == 201
    return dict(response.json())


@pytest.fixture
def lease(client: TestClient, study: Json) -> Json:
    """A lease of six instances of the study by worker `w`."""
    response = client.post("/v1/leases", json=asking(max_instances=6))
    assert response.status_code == 201
    return dict(response.json())


def test_a_lease_says_what_to_evaluate(client: TestClient, study: Json, clock: Any) -> None:
    response = client.post("/v1/leases", json=asking(max_instances=6))
    assert response.status_code == 201
    lease = response.json()
    assert lease["expires_at"] == clock.now + 60.0
    assert lease["ttl_seconds"] == 60.0
    assert isinstance(lease["fence"], int)
    ranges = {
        f["name"]: Uniform(low=f["distribution"]["low"], high=f["distribution"]["high"])
        for f in study["factors"]
    }
    points = [instance_parameters("saltelli", DEFAULT_SAMPLING, 1, row, ranges) for row in (0, 1)]
    places = [(0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (1, 0)]
    names = [f"{study['id']}:{row}:{position}" for row, position in places]
    assert [i.pop("id") for i in lease["instances"]] == names
    # One for each row: what differs within it is what the parameters do.
    assert len({i.pop("model_seed") for i in lease["instances"]}) == 2
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
    response = client.post("/v1/leases", json=asking())
    assert (response.status_code, response.content) == (204, b"")
    assert int(response.headers["retry-after"]) >= 1


@pytest.mark.parametrize("changes", [{"max_instances": 0}, {"max_instances": 1001}, {"models": []}])
def test_a_greedy_or_empty_request_for_work_is_refused(client: TestClient, changes: Json) -> None:
    is_problem(client.post("/v1/leases", json=asking(**changes)), 422)


@pytest.mark.parametrize(
    "id_", ["=cmd|' /C calc'!A0", "+1", "-1+2", "@SUM(A1)", "\tx", "\rx", "a\u202eb"]
)
def test_a_worker_whose_id_a_spreadsheet_would_compute_is_refused(
    client: TestClient, id_: str
) -> None:
    asked = asking(worker={"id": id_, "host": "h"})
    posted = {**posting({"id": "l", "fence": 1}, []), "next": asked}
    for path, body, where in (
        ("/v1/leases", asked, "/worker/id"),
        ("/v1/results", posted, "/next/worker/id"),
    ):
        faults = dict(faults_of(client.post(path, json=body)))
        assert faults[where] == (
            "must be one line without control characters that begins with none of = + - @, which "
            "is a formula in spreadsheets"
        )
    good = asking(worker={"id": "lab-2@pc7-4711 =1", "host": "h"})
    assert client.post("/v1/leases", json=good).status_code == 204


def test_a_lease_is_renewed_released_and_then_gone(
    client: TestClient, lease: Json, clock: Any
) -> None:
    path, proof = f"/v1/leases/{lease['id']}", {"fence": lease["fence"]}
    clock.advance(30.0)
    assert client.post(f"{path}/renew", json=proof).json() == {
        "expires_at": clock.now + 60.0,
        "ttl_seconds": 60.0,
    }
    is_problem(client.post(f"{path}/renew", json={"fence": lease["fence"] + 1}), 409)
    assert client.post(f"{path}/release", json=proof).status_code == 200
    assert client.post(f"{path}/release", json=proof).status_code == 200
    assert "released" in is_problem(client.post(f"{path}/renew", json=proof), 409)["detail"]
    is_problem(client.post("/v1/leases/nothing/renew", json=proof), 409)


def test_asking_for_work_takes_back_what_expired(
    client: TestClient, lease: Json, clock: Any
) -> None:
    clock.advance(61.0)
    again = client.post("/v1/leases", json=asking(max_instances=6)).json()
    assert [i["id"] for i in again["instances"]] == [i["id"] for i in lease["instances"]]
    assert again["fence"] > lease["fence"]


def test_what_is_granted_in_answers_that_get_lost_does_not_count_as_lost(
    client: TestClient, study: Json, clock: Any
) -> None:
    for _ in range(20):
        # Its worker never hears the answer, and asks again.
        client.post("/v1/leases", json=asking())
        clock.advance(25.0)
    clock.advance(60.0)
    progress = client.get(f"/v1/studies/{study['id']}/progress").json()
    assert (progress["state"], progress["failures"]) == ("running", {})
    lease = client.post("/v1/leases", json=asking()).json()
    answer = client.post("/v1/results", json=posting(lease, [*map(result, lease["instances"])]))
    assert answer.status_code == 200
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["state"] == "complete"


def test_expired_leases_are_looked_for_once_a_second_however_many_ask(
    client: TestClient, lease: Json, clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[float] = []

    def look(_engine: Any, *, now: float, ttl: float) -> int:
        looked.append(now)
        return 0

    # Before, nothing can have been lost.
    clock.advance(60.0)
    client.post("/v1/leases", json=asking())
    monkeypatch.setattr(leases, "reap", look)
    for seconds in (0.5, 0.4, 0.2, 0.5, -10.0):
        clock.advance(seconds)
        client.post("/v1/leases", json=asking())
    assert len(looked) == 2


def test_good_results_are_accepted(client: TestClient, lease: Json) -> None:
    results = [result(i) for i in lease["instances"]]
    response = client.post("/v1/results", json=posting(lease, results))
    assert response.status_code == 200
    assert response.json() == {
        "verdicts": [
            {"instance": i["id"], "verdict": "accepted", "detail": ""} for i in lease["instances"]
        ]
    }
    again = client.post("/v1/results", json=posting(lease, results))
    assert again.status_code == 200
    assert {v["verdict"] for v in again.json()["verdicts"]} == {"duplicate"}


def test_one_refusal_makes_it_409_but_the_good_ones_are_taken(
    client: TestClient, study: Json, lease: Json
) -> None:
    a, b, c, d, e, f = lease["instances"]
    text = json.dumps(
        posting(
            lease,
            [
                result(a, outputs={"y": float("nan")}),
                result(b),
                result({"id": "forged"}),
                result(c, outputs=None),
                result(d, outcome="x" * 300),
                result(e, reason=5),
                result(f, state=[1]),
            ],
        )
    )
    response = client.post(
        "/v1/results", content=text, headers={"Content-Type": "application/json"}
    )
    assert response.status_code == 409
    verdicts = response.json()["verdicts"]
    assert [v["verdict"] for v in verdicts] == ["invalid", "accepted", "unknown", *["invalid"] * 4]
    assert all(v["detail"] for v in verdicts if v["verdict"] != "accepted")
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["ok"] == 1


def test_a_result_in_which_a_key_comes_twice_is_refused(client: TestClient, lease: Json) -> None:
    """Of `{"y": 1.0, "y": 2.0}` the last was taken; studies refuse such JSON."""
    whole = json.dumps(posting(lease, [result(lease["instances"][0])]))
    assert '"outputs": {"y": ' in whole
    body = whole.replace('"outputs": {"y": ', '"outputs": {"y": 1.0, "y": ')
    answer = client.post("/v1/results", content=body, headers=JSON)
    is_problem(answer, 422)
    assert "the key 'y' comes twice in an object: leave out one" in answer.text
    assert client.post("/v1/results", content=whole, headers=JSON).status_code == 200


def test_half_a_character_and_an_unknown_key_spoil_no_other_result(
    client: TestClient, lease: Json, study: Json
) -> None:
    a, b, c, d, e, f = lease["instances"]
    spoilt = [
        result(a, reason="\ud800"),
        result(b, reason="\U0001d516, which JSON writes as two halves"),
        result(c, outcome="slipped", state={"where": ["\udc00"]}),
        result(d, outcome="slipped", state={"\ud800": 1}),
        result(e, seconds=0.1),
        result(f, **{"\ud800": 1}),
        result({"id": "\ud800"}),
    ]
    answer = client.post(
        "/v1/results",
        content=json.dumps(posting(lease, spoilt)),
        headers={"Content-Type": "application/json"},
    )
    assert answer.status_code == 409
    verdicts = answer.json()["verdicts"]
    assert [v["verdict"] for v in verdicts] == ["invalid", "accepted", *["invalid"] * 4, "unknown"]
    assert "holds half of a character" in verdicts[0]["detail"]
    assert "'seconds'" in verdicts[4]["detail"] and r"\ud800" in verdicts[5]["detail"]
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["ok"] == 1
    # Where a text is asked for, the request says where.
    who = asking(worker={"id": "\ud800", "host": "h", "versions": {}})
    refused = client.post(
        "/v1/leases", content=json.dumps(who), headers={"Content-Type": "application/json"}
    )
    assert is_problem(refused, 422)["pointer"] == "/worker/id"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_json_that_is_not_in_utf_8_is_told_so_at_every_route(
    client: TestClient, lease: Json, encoding: str
) -> None:
    bodies: dict[str, Json] = {
        "/v1/results": posting(lease, [result(lease["instances"][0])]),
        "/v1/leases": asking(),
        "/v1/studies": STUDY,
        "/v1/models": {},
    }
    for path, body in bodies.items():
        for kind in ("application/json", f"application/vnd.x+json; charset={encoding}"):
            sent = json.dumps(body).encode(encoding)
            answer = client.post(path, content=sent, headers={"Content-Type": kind})
            said = is_problem(answer, 415)["detail"]
            assert said == f"the body is in {encoding[:6].upper()}: send JSON in UTF-8", path


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        ("application/json", 200),
        ("application/JSON; charset=utf-8", 200),
        ("application/vnd.x+json", 200),
        ("text/plain", 415),
        ("", 415),
    ],
)
def test_results_are_taken_if_they_are_called_json(
    client: TestClient, lease: Json, kind: str, status: int
) -> None:
    text = json.dumps(posting(lease, [result(lease["instances"][0])]))
    # Windows writes a mark before it.
    sent = text.encode("utf-8-sig")
    response = client.post("/v1/results", content=sent, headers={"Content-Type": kind})
    assert response.status_code == status
    if status == 415:
        assert "send application/json" in response.json()["detail"]


WITHOUT_SHAPE: list[Json] = [
    {"results": []},
    {"results": [{"outcome": "ok"}]},
    {"results": "all of them"},
    {"fence": -1},
    {"fence": 2**63},
    {"worker": "w\u0000"},
    {"lease": 5},
]


def test_a_post_without_shape_is_a_problem(client: TestClient, lease: Json) -> None:
    for changes in WITHOUT_SHAPE:
        body = posting(lease, [result(lease["instances"][0])])
        is_problem(client.post("/v1/results", json={**body, **changes}), 422)


def test_progress_says_how_many_results_no_analysis_has_taken_in_for_a_while(
    client: TestClient, engine: Engine, study: Json, lease: Json, clock: Any
) -> None:
    path = f"/v1/studies/{study['id']}/progress"

    def left() -> Any:
        return client.get(path).json()["left_by_analysis"]

    def page() -> str:
        return client.get(f"/studies/{study['id']}", headers={"Accept": "text/html"}).text

    client.post("/v1/results", json=posting(lease, [result(i) for i in lease["instances"]]))
    seen = client.get(path).headers["ETag"]
    clock.advance(UNSEEN_SECONDS)
    assert left() == 0
    said = f"{len(lease['instances'])} results wait for an analysis: if none runs, start"
    assert said not in page()
    clock.advance(1.0)
    assert left() == len(lease["instances"])
    # Of a study that is over as well, whose indices are looked at.
    client.post(f"/v1/studies/{study['id']}/cancel")
    assert said in page()
    assert client.get(path, headers={"If-None-Match": seen}).status_code == 200
    catch_up(StoreResultLog(engine), study["id"])
    assert left() == 0
    assert said not in page()


def test_progress_adds_up(client: TestClient, study: Json, lease: Json, clock: Any) -> None:
    clock.advance(10.0)
    a, b, c, d, e, _ = lease["instances"]
    results = [result(i) for i in (a, b, c, d)] + [result(e, outcome="diverged", outputs={})]
    assert client.post("/v1/results", json=posting(lease, results)).status_code == 200
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
        "eta_low_seconds": None,
        "eta_high_seconds": None,
        "workers": 1,
        "waits_for": None,
        "why_it_waits": None,
        "left_by_analysis": 0,
        "elapsed_seconds": 20.0,
        "precision": None,
    }


def test_indices_are_empty_until_the_analysis_has_published(
    client: TestClient, app: FastAPI, study: Json, lease: Json
) -> None:
    path = f"/v1/studies/{study['id']}/indices"
    empty = client.get(path).json()
    assert (empty["study"], empty["cursor"], empty["rows_used"]) == (study["id"], 0, 0)
    results = [result(i, outputs={"y": float(k)}) for k, i in enumerate(lease["instances"])]
    client.post("/v1/results", json=posting(lease, results))
    catch_up(StoreResultLog(app.state.engine), study["id"])
    snapshot = client.get(path).json()
    assert (snapshot["cursor"], snapshot["rows_complete"]) == (6, 1)
    assert set(snapshot["outputs"]["y"]["factors"]) == {"x1", "x2", "x3"}


def test_results_are_downloaded_as_a_table(client: TestClient, study: Json, lease: Json) -> None:
    a, b, *_ = lease["instances"]
    results = [result(b, outcome="diverged", outputs={}), result(a)]
    client.post("/v1/results", json=posting(lease, results))
    response = client.get(f"/v1/studies/{study['id']}/results.csv")
    assert response.headers["content-type"] == "text/csv; charset=utf-8"
    first, second = csv.DictReader(io.StringIO(response.text))
    assert {name: float(first[name]) for name in a["parameters"]} == a["parameters"]
    assert (first["row"], first["position"], first["outcome"]) == ("0", "0", "ok")
    assert (first["y"], first["wall_seconds"], first["worker"]) == ("0.5", "0.125", "w")
    assert (second["position"], second["outcome"], second["y"]) == ("1", "diverged", "")


def test_results_are_downloaded_as_parquet_too(
    client: TestClient, study: Json, lease: Json, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b, *_ = lease["instances"]
    results = [result(b, outcome="diverged", outputs={}), result(a)]
    client.post("/v1/results", json=posting(lease, results))
    path = f"/v1/studies/{study['id']}/results.parquet"
    response = client.get(path)
    assert response.headers["content-type"] == "application/vnd.apache.parquet"
    table = parquet.read_table(io.BytesIO(response.content))
    first, second = table.to_pylist()
    assert {name: first[name] for name in a["parameters"]} == a["parameters"]
    assert (first["row"], first["position"], first["outcome"]) == (0, 0, "ok")
    assert (first["y"], first["wall_seconds"], first["worker"]) == (0.5, 0.125, "w")
    assert (second["position"], second["outcome"], second["y"]) == (1, "diverged", None)
    assert json.loads(table.schema.metadata[STUDY_KEY])["id"] == study["id"]
    monkeypatch.setattr("server.routes.fleet.results.find_spec", lambda _: None)
    assert "install 'rehyb[files]'" in is_problem(client.get(path), 501)["detail"]


def test_cancelling_stops_the_leasing(client: TestClient, study: Json) -> None:
    response = client.post(f"/v1/studies/{study['id']}/cancel")
    assert (response.status_code, response.json()["state"]) == (200, "cancelled")
    assert client.post("/v1/leases", json=asking()).status_code == 204


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
                "models": {"ishigami": ""},
                "refused": {},
                "agreed": 0,
                "disagreed": 0,
                "trust": 1.0,
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
