"""The REST interface for studies under way: control, instances, events, tags and metrics."""

import gzip
import json
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from analysis.sensitivity.service import catch_up
from server.operations.study.result_log import StoreResultLog
from tests.testbed.clock import Clock
from tests.testbed.coordinators.rest_bodies import STUDY, Json, is_problem, posting, result


@pytest.fixture
def study(client: TestClient) -> str:
    """A study of two rows of five."""
    return str(client.post("/v1/studies", json=STUDY).json()["id"])


def asking(n: int = 10, versions: Json | None = None) -> Json:
    worker = {"id": "w", "host": "spare-pc", "versions": versions or {"mujoco": "4.0.1"}}
    return {"worker": worker, "models": ["ishigami"], "max_instances": n}


def work(client: TestClient, *, fail: int = 0, n: int = 10) -> Json:
    """Lease and post `n` instances, the first `fail` of them as failures."""
    lease = dict(client.post("/v1/leases", json=asking(n)).json())
    results = [
        {
            "instance": instance["id"],
            "outcome": "diverged" if k < fail else "ok",
            "outputs": {} if k < fail else {"y": float(k)},
            "reason": "blew up" if k < fail else "",
            "state": {"qpos": [0.5]} if k < fail else None,
            "wall_seconds": 0.25,
        }
        for k, instance in enumerate(lease["instances"])
    ]
    body = {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": results}
    response = client.post("/v1/results", json=body)
    assert response.status_code == 200
    return lease


def test_a_study_is_paused_resumed_preferred_extended_and_deleted(
    client: TestClient, study: str
) -> None:
    path = f"/v1/studies/{study}"
    assert client.post(f"{path}/pause").json()["state"] == "paused"
    assert client.post("/v1/leases", json=asking()).status_code == 204
    assert client.post(f"{path}/resume").json()["state"] == "running"
    assert client.post(f"{path}/priority", json={"priority": 7}).json()["priority"] == 7
    assert client.post(f"{path}/extend", json={"rows": 5}).json()["instances"] == 25
    assert client.post(f"{path}/extend", json={"rows": 4}).status_code == 409
    assert client.delete(path).status_code == 409
    assert client.post(f"{path}/cancel").json()["state"] == "cancelled"
    assert client.post(f"{path}/resume").status_code == 409
    assert client.delete(path).status_code == 204
    assert client.delete(path).status_code == 404


def test_too_many_rows_are_the_same_mistake_of_a_new_study_and_of_one_that_is_there(
    client: TestClient, study: str
) -> None:
    for rows in (10**20, 0):
        new = client.post("/v1/studies", json={**STUDY, "rows": rows})
        more = client.post(f"/v1/studies/{study}/extend", json={"rows": rows})
        assert is_problem(more, 422) == is_problem(new, 422)
        assert more.json()["pointer"] == "/rows"


def test_the_failed_run_again(client: TestClient, study: str) -> None:
    work(client, fail=2)
    answer = client.post(f"/v1/studies/{study}/rerun", json={}).json()
    assert (answer["taken_back"], answer["state"]) == (2, "running")
    work(client)
    progress = client.get(f"/v1/studies/{study}/progress").json()
    assert (progress["state"], progress["ok"], progress["failures"]) == ("complete", 10, {})
    assert client.post(f"/v1/studies/{study}/rerun", json={"which": "x"}).status_code == 422


def test_all_is_not_taken_back_where_only_some_failures_were_meant(
    client: TestClient, study: str
) -> None:
    work(client, fail=2)
    refused = client.post(f"/v1/studies/{study}/rerun", json={"which": "all", "outcomes": ["lost"]})
    assert refused.status_code == 422 and "leave out outcomes" in refused.text
    progress = client.get(f"/v1/studies/{study}/progress").json()
    assert (progress["state"], progress["ok"]) == ("complete", 8)


@pytest.mark.parametrize("which", ["failed", "all"])
def test_a_request_that_is_repeated_does_not_undo_that_its_results_were_taken_back(
    client: TestClient, study: str, clock: Clock, which: str
) -> None:
    lease = dict(client.post("/v1/leases", json=asking()).json())
    failed = [result(one, outcome="diverged", outputs={}) for one in lease["instances"]]
    assert client.post("/v1/results", json=posting(lease, failed)).status_code == 200
    clock.advance(1.0)
    rerun = client.post(f"/v1/studies/{study}/rerun", json={"which": which}).json()
    assert rerun["taken_back"] == 10
    clock.advance(1.0)

    def repeat() -> set[tuple[str, str]]:
        verdicts = client.post("/v1/results", json=posting(lease, failed)).json()["verdicts"]
        return {(one["verdict"], one["detail"]) for one in verdicts}

    told = {("duplicate", "its result was taken back meanwhile: it runs again")}
    assert repeat() == told
    again = dict(client.post("/v1/leases", json=asking()).json())
    assert repeat() == told
    # Its own late results are as good as any.
    clock.advance(100.0)
    client.post("/v1/leases", json=asking())
    good = client.post("/v1/results", json=posting(again, [*map(result, again["instances"])]))
    assert {one["verdict"] for one in good.json()["verdicts"]} == {"accepted"}
    progress = client.get(f"/v1/studies/{study}/progress").json()
    assert (progress["state"], progress["ok"]) == ("complete", 10)


def test_a_worker_that_fits_nothing_is_told_why(client: TestClient, study: str) -> None:
    client.post("/v1/leases", json=asking(1))
    response = client.post("/v1/leases", json=asking(1, {"mujoco": "3.2.0"}))
    assert response.status_code == 409
    assert "was begun with code unknown, mujoco 4.0.1" in response.json()["detail"]


def test_failures_are_listed_in_pages_that_neither_miss_nor_repeat(
    client: TestClient, study: str
) -> None:
    work(client, fail=5)
    path = f"/v1/studies/{study}/instances"
    seen: list[str] = []
    after = ""
    while True:
        page = client.get(f"{path}?state=failed&limit=2{after}").json()
        seen += [item["id"] for item in page["instances"]]
        if page["next"] is None:
            break
        after = f"&after={page['next']}"
    assert seen == [f"{study}:0:{position}" for position in range(5)]
    assert {item["outcome"] for item in page["instances"]} == {"diverged"}
    # A model may call its failures what a result may be called.
    for name in ("slipped", "phase2_diverged"):
        assert client.get(f"{path}?outcome={name}").json() == {"instances": [], "next": None}
    assert len(client.get(f"{path}?state=ok").json()["instances"]) == 5
    assert client.get(f"{path}?state=odd").status_code == 422


def test_a_bundle_holds_what_it_takes_to_replay(client: TestClient, study: str) -> None:
    lease = work(client, fail=1)
    bundle = client.get(f"/v1/studies/{study}/instances/0/0").json()
    assert bundle["parameters"] == lease["instances"][0]["parameters"]
    assert (bundle["model"], bundle["seed"], bundle["state"]) == ("ishigami", 1, "done")
    result = bundle["result"]
    assert (result["outcome"], result["reason"]) == ("diverged", "blew up")
    assert (result["state"], result["worker"]) == ({"qpos": [0.5]}, "w")
    assert (result["host"], result["versions"]) == ("spare-pc", {"mujoco": "4.0.1"})
    client.post(f"/v1/studies/{study}/rerun", json={})
    again = client.get(f"/v1/studies/{study}/instances/0/0").json()
    assert (again["state"], again["result"]) == ("pending", None)
    assert [old["outcome"] for old in again["superseded"]] == ["diverged"]


def test_an_instance_that_nobody_has_begun_can_be_replayed_too(
    client: TestClient, study: str
) -> None:
    bundle = client.get(f"/v1/studies/{study}/instances/1/4").json()
    assert (bundle["state"], bundle["result"]) == ("waiting", None)
    assert set(bundle["parameters"]) == {"x1", "x2", "x3"}
    missing = client.get(f"/v1/studies/{study}/instances/2/0")
    assert (missing.status_code, "has 2 rows of 5" in missing.json()["detail"]) == (404, True)


def test_progress_is_sent_again_only_if_something_happened(
    client: TestClient, study: str, clock: Any
) -> None:
    path = f"/v1/studies/{study}/progress"
    first = client.get(path)
    known = {"If-None-Match": first.headers["etag"]}
    assert (client.get(path, headers=known).status_code, first.status_code) == (304, 200)
    clock.advance(11.0)
    assert client.get(path, headers=known).status_code == 200
    known = {"If-None-Match": client.get(path).headers["etag"]}
    work(client)
    assert client.get(path, headers=known).status_code == 200


def test_indices_are_sent_again_only_if_they_changed(
    client: TestClient, app: FastAPI, study: str
) -> None:
    path = f"/v1/studies/{study}/indices"
    known = {"If-None-Match": client.get(path).headers["etag"]}
    assert client.get(path, headers=known).status_code == 304
    work(client)
    assert client.get(path, headers=known).status_code == 304
    catch_up(StoreResultLog(app.state.engine), study)
    changed = client.get(path, headers=known)
    assert (changed.status_code, changed.json()["cursor"]) == (200, 10)
    assert client.get(path, headers={"If-None-Match": "*"}).content == b""


def test_events_tell_of_every_change_until_the_end(client: TestClient, study: str) -> None:
    work(client)
    response = client.get(f"/v1/studies/{study}/events")
    assert response.headers["content-type"].startswith("text/event-stream")
    (event,) = response.text.strip().split("\n\n")
    kind, data = event.split("\n")
    assert kind == "event: progress"
    assert json.loads(data.removeprefix("data: "))["state"] == "complete"
    assert client.get("/v1/studies/nothing/events").status_code == 404


def test_metrics_count_what_happened(client: TestClient, study: str) -> None:
    work(client, fail=3, n=7)
    client.post("/v1/leases", json=asking(1, {"mujoco": "3.2.0"}))
    values = {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(client.get("/metrics").text)
        for sample in family.samples
    }
    assert values["rehyb_studies", "running"] == 1
    assert values["rehyb_instances", "ok"] == 4
    assert values["rehyb_instances", "failed"] == 3
    assert values["rehyb_failures", "diverged"] == 3
    assert values["rehyb_verdicts_total", "accepted"] == 7
    assert values["rehyb_leases_granted_total",] == 1
    assert values["rehyb_misfits_total",] == 1
    assert values["rehyb_analysis_lag",] == 7
    assert values["rehyb_run_seconds_count",] == 7


def test_a_body_may_be_compressed_but_not_a_bomb(client: TestClient) -> None:
    headers = {"Content-Type": "application/json", "Content-Encoding": "gzip"}
    packed = gzip.compress(json.dumps(STUDY).encode())
    assert client.post("/v1/studies", content=packed, headers=headers).status_code == 201
    bomb = gzip.compress(b" " * 50_000_000)
    assert len(bomb) < 100_000
    assert client.post("/v1/studies", content=bomb, headers=headers).status_code == 413
    for broken in (b"no gzip at all", packed[:-9], packed + b"more"):
        response = client.post("/v1/studies", content=broken, headers=headers)
        assert response.status_code == 400, broken
        assert response.headers["content-type"] == "application/problem+json"
    headers["Content-Encoding"] = "br"
    assert client.post("/v1/studies", content=packed, headers=headers).status_code == 415


def test_every_request_body_has_an_example_that_the_coordinator_understands(
    client: TestClient,
) -> None:
    document = client.get("/openapi.json").json()
    shown = 0
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            body = operation.get("requestBody", {"content": {}})["content"]
            # What is uploaded as a file has its example in `test_openapi`.
            if "application/json" not in body:
                continue
            schema = body["application/json"]["schema"]
            if "$ref" in schema:
                schema = document["components"]["schemas"][schema["$ref"].split("/")[-1]]
            (example,) = schema["examples"]
            response = client.request(method, path.replace("{study_id}", "x"), json=example)
            assert response.status_code not in (400, 422), (path, response.json())
            shown += 1
    assert shown >= 8


def test_how_much_work_there_is_can_be_asked_by_whatever_starts_workers(
    client: TestClient, study: str
) -> None:
    def told() -> Json:
        return dict(client.get("/v1/work").json())

    assert told() == {"waiting": 10, "under_way": 0}
    client.post("/v1/leases", json=asking(4))
    assert told() == {"waiting": 6, "under_way": 4}
    client.post(f"/v1/studies/{study}/drain")
    assert told() == {"waiting": 1, "under_way": 4}, "the row that was begun is finished"
    client.post(f"/v1/studies/{study}/pause")
    assert told() == {"waiting": 0, "under_way": 4}
