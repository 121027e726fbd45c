"""Results posted and the next instances leased in one request."""

from typing import Any

import pytest
from fastapi import FastAPI, Response
from fastapi.testclient import TestClient

from server.operations import check
from server.routes.fleet import results
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, is_problem, posting, result


def submit(client: TestClient, **changes: Any) -> Json:
    response = client.post("/v1/studies", json={**STUDY, **changes})
    assert response.status_code == 201
    return dict(response.json())


def exchange(client: TestClient, lease: Json, wish: Json, **changes: Any) -> Any:
    results = [result(i, **changes) for i in lease["instances"]]
    return client.post("/v1/results", json=posting(lease, results, next=wish))


@pytest.fixture
def study(client: TestClient) -> Json:
    """A study of two rows of five."""
    return submit(client)


@pytest.fixture
def lease(client: TestClient, study: Json) -> Json:
    """A lease of its first row."""
    return dict(client.post("/v1/leases", json=asking(max_instances=5)).json())


def places(lease: Json) -> list[tuple[int, int]]:
    return [(i["row"], i["position"]) for i in lease["instances"]]


def test_the_answer_brings_verdicts_and_the_next_lease(
    app: FastAPI, client: TestClient, study: Json, lease: Json, clock: Any
) -> None:
    response = exchange(client, lease, asking(max_instances=3))
    answer = response.json()
    assert response.status_code == 200
    assert {v["verdict"] for v in answer["verdicts"]} == {"accepted"}
    following = answer["next"]
    assert places(following) == [(1, 0), (1, 1), (1, 2)]
    assert following["fence"] > lease["fence"]
    assert following["expires_at"] == clock.now + following["ttl_seconds"]
    assert set(following["instances"][0]) == set(lease["instances"][0])
    assert answer["misfit"] is None
    progress = client.get(f"/v1/studies/{study['id']}/progress").json()
    assert (progress["ok"], progress["leased"]) == (5, 3)
    assert check.faults(app.state.engine) == []


def test_a_worker_may_want_fewer_of_a_model_and_no_nonsense_of_it(
    client: TestClient, study: Json, lease: Json
) -> None:
    wish = asking(max_instances=1000, at_most={"ishigami": 2, "elbow": 1})
    following = exchange(client, lease, wish).json()["next"]
    assert places(following) == [(1, 0), (1, 1)]
    for nonsense in ({"ishigami": 0}, {"ishigami": 1001}, {"ishigami": None}, {"": 1}):
        refused = client.post("/v1/leases", json=asking(at_most=nonsense))
        assert is_problem(refused, 422), nonsense


def test_a_worker_is_answered_before_its_results_are_counted(
    client: TestClient, lease: Json, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    answer = Response.__call__

    async def answering(self: Response, *given: Any) -> None:
        order.append("answered")
        await answer(self, *given)

    monkeypatch.setattr(Response, "__call__", answering)
    monkeypatch.setattr(results, "_note", lambda *_: order.append("counted"))
    exchange(client, lease, asking(max_instances=3))
    client.get("/healthz")
    assert order == ["answered", "counted", "answered"]


def test_results_that_are_refused_keep_nobody_from_the_next_lease(
    client: TestClient, lease: Json
) -> None:
    response = exchange(client, lease, asking(max_instances=3), outputs={"y": "nonsense"})
    assert response.status_code == 409
    assert {v["verdict"] for v in response.json()["verdicts"]} == {"invalid"}
    assert len(response.json()["next"]["instances"]) == 3


def test_results_under_an_unknown_lease_keep_nobody_from_the_next_lease(
    client: TestClient, lease: Json
) -> None:
    response = exchange(client, {**lease, "id": "nothing"}, asking(max_instances=3))
    assert {v["verdict"] for v in response.json()["verdicts"]} == {"unknown"}
    assert len(response.json()["next"]["instances"]) == 3


def test_without_further_work_there_is_no_lease_and_a_time_to_ask_again(
    client: TestClient, lease: Json
) -> None:
    rest = exchange(client, lease, asking()).json()["next"]
    response = exchange(client, rest, asking())
    assert (response.json()["next"], response.json()["misfit"]) == (None, None)
    assert int(response.headers["retry-after"]) >= 1


def test_who_fits_no_study_is_told_so_and_its_results_are_taken(
    client: TestClient, lease: Json
) -> None:
    other = {"id": "w", "host": "spare-pc", "versions": {"mujoco": "3.0"}}
    response = exchange(client, lease, asking(worker=other))
    assert response.status_code == 200
    assert {v["verdict"] for v in response.json()["verdicts"]} == {"accepted"}
    assert response.json()["next"] is None
    assert "this worker has code unknown, mujoco 3.0" in response.json()["misfit"]


def test_the_next_lease_may_be_of_another_study(
    app: FastAPI, client: TestClient, lease: Json
) -> None:
    urgent = submit(client, name="urgent", priority=5)
    response = exchange(client, lease, asking(max_instances=4))
    assert {i["study"] for i in response.json()["next"]["instances"]} == {urgent["id"]}
    assert check.faults(app.state.engine) == []


def test_what_comes_twice_is_a_duplicate_and_its_second_lease_another_one(
    app: FastAPI, client: TestClient, lease: Json
) -> None:
    first = exchange(client, lease, asking(max_instances=2)).json()
    again = exchange(client, lease, asking(max_instances=2)).json()
    assert {v["verdict"] for v in again["verdicts"]} == {"duplicate"}
    assert not set(places(first["next"])) & set(places(again["next"]))
    assert check.faults(app.state.engine) == []


def brought(client: TestClient) -> dict[str, int]:
    """Return how many final results each worker has brought."""
    return {w["id"]: w["instances_done"] for w in client.get("/v1/workers").json()["workers"]}


def test_a_worker_s_results_count_once_wherever_the_next_lease_comes_from(
    client: TestClient, lease: Json
) -> None:
    following = exchange(client, lease, asking(max_instances=3)).json()["next"]
    assert brought(client) == {"w": 5}
    submit(client, name="urgent", priority=5)
    elsewhere = exchange(client, following, asking(max_instances=1)).json()["next"]
    assert elsewhere["instances"][0]["study"] != following["instances"][0]["study"]
    assert brought(client) == {"w": 8}
    exchange(client, following, asking(max_instances=1))
    assert brought(client) == {"w": 8}


def test_results_count_for_the_worker_that_computed_them_whoever_asks_for_more(
    client: TestClient, lease: Json
) -> None:
    other = {"id": "other", "host": "pc", "versions": {"mujoco": "4.0.1"}}
    assert exchange(client, lease, asking(worker=other)).json()["next"] is not None
    assert brought(client) == {"w": 5, "other": 0}


def test_a_wish_that_cannot_be_read_says_where(client: TestClient, lease: Json) -> None:
    problem = is_problem(exchange(client, lease, asking(max_instances=0)), 422)
    assert problem["pointer"] == "/next/max_instances"
