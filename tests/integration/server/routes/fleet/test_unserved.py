"""Why nobody works on a study, told over REST and on the pages."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from server.logic.fleet.hosts import host_class
from server.logic.fleet.own_models import own_versions
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, posting, result


@pytest.fixture
def study(client: TestClient) -> Json:
    """A study of two rows of five."""
    return dict(client.post("/v1/studies", json=STUDY).json())


@pytest.fixture
def lease(client: TestClient, study: Json) -> Json:
    """A lease of six instances of the study by worker `w`."""
    return dict(client.post("/v1/leases", json=asking(max_instances=6)).json())


def test_progress_says_why_nobody_who_is_there_works_on_a_study(
    client: TestClient, study: Json, lease: Json
) -> None:
    path = f"/v1/studies/{study['id']}"

    def why() -> Any:
        return client.get(f"{path}/progress").json()["why_it_waits"]

    client.post("/v1/results", json=posting(lease, [result(i) for i in lease["instances"]]))
    assert why() is None
    # After an update of its host the worker is of another version.
    other = {"id": "w", "host": "spare-pc", "versions": {"mujoco": "9.9.9"}}
    assert client.post("/v1/leases", json=asking(worker=other)).status_code == 409
    assert "begun with code unknown, mujoco 4.0.1, but this worker has" in why()
    page = client.get(f"/studies/{study['id']}", headers={"Accept": "text/html"}).text
    assert "No worker is on this study now: study" in page and "mujoco 9.9.9" in page


def test_who_began_a_study_and_gave_it_back_without_a_result_keeps_it_from_nobody(
    client: TestClient, study: Json
) -> None:
    silent = {"id": "evil", "host": "nowhere", "versions": {}}
    lease = client.post("/v1/leases", json=asking(worker=silent, max_instances=6)).json()
    assert client.post("/v1/leases", json=asking()).status_code == 409
    given_back = client.post(f"/v1/leases/{lease['id']}/release", json={"fence": lease["fence"]})
    assert given_back.status_code == 200
    mine = client.post("/v1/leases", json=asking()).json()
    assert len(mine["instances"]) == 10, "all of both rows, begun or not"
    posted = posting(mine, [result(one) for one in mine["instances"]])
    assert client.post("/v1/results", json=posted).status_code == 200
    assert client.get(f"/v1/studies/{study['id']}").json()["state"] == "complete"


@pytest.mark.parametrize("model", ["elbow_passive", "elbow_bushing_effects"])
def test_a_worker_of_an_older_rehyb_is_told_what_it_lacks_and_progress_and_page_say_so(
    client: TestClient, model: str
) -> None:
    study = client.post("/v1/studies", json={**STUDY, "model": model, "factors": None}).json()
    own = own_versions() | {"elbow_bushing_effects": "elbow_bushing_effects@0123456789abcdef"}
    del own["elbow_passive"]
    named = [*own, *own.values()]
    refused = client.post("/v1/leases", json=asking(models=named))
    assert refused.status_code == 409
    why = refused.json()["detail"]
    assert f"samples {model}, which" in why and "install the same rehyb" in why
    path = f"/studies/{study['id']}"
    assert client.get(f"/v1{path}/progress").json()["why_it_waits"] == why
    page = client.get(path, headers={"Accept": "text/html"}).text
    assert f"No worker is on this study now: {why}." in page
    assert why in client.get("/fleet", headers={"Accept": "text/html"}).text
    # Of what it has it may have work.
    client.post("/v1/studies", json=STUDY)
    assert client.post("/v1/leases", json=asking(models=named)).status_code == 201


def test_progress_and_fleet_say_that_rows_wait_for_a_kind_of_machine_that_is_gone(
    client: TestClient, study: Json, lease: Json, clock: Any
) -> None:
    path = f"/v1/studies/{study['id']}"

    def ask(worker: str, **versions: str) -> int:
        one = {"id": worker, "host": worker, "versions": {"mujoco": "4.0.1", **versions}}
        return client.post("/v1/leases", json=asking(worker=one)).status_code

    def why() -> Any:
        return client.get(f"{path}/progress").json()["why_it_waits"]

    # The first holds one row and began the other.
    clock.advance(120.0)
    assert ask("other", cpu="other") == 204
    kind = host_class({"mujoco": "4.0.1"})
    assert why().startswith(
        f"10 instances of begun rows can go to machines of class {kind} only, and none of these "
        "was heard from for 2 minutes: their rows begin anew on any machine in 58 minutes"
    )
    page = client.get("/fleet", headers={"Accept": "text/html"}).text
    assert f"machines of class {kind} only" in page
    assert ask("w") == 201
    assert why() is None


def of_group(name: str, **said: Any) -> Json:
    return {"id": name, "host": name, "versions": {"mujoco": "4.0.1"}, **said}


def test_whoever_starts_workers_is_told_what_those_of_a_group_may_not_have(
    client: TestClient, clock: Any
) -> None:
    tagged = client.post("/v1/studies", json={**STUDY, "tags": ["gpu"]}).json()

    def told(group: str = "day_") -> Json:
        return dict(client.get(f"/v1/work?group={group}").json())

    nothing_known = {"waiting": 10, "under_way": 0, "unfit": 0, "why": ""}
    assert told() == nothing_known
    for name in ("day_@1", "dayx@1", "day@1"):
        assert client.post("/v1/leases", json=asking(worker=of_group(name))).status_code == 409
    why = f"study {tagged['id']} is for workers tagged gpu (rehyb-worker --tags)"
    assert told() == {"waiting": 0, "under_way": 0, "unfit": 10, "why": why}
    assert told("night") == nothing_known
    assert client.get("/v1/work").json() == {"waiting": 10, "under_way": 0}
    clock.advance(900.0)
    assert told()["waiting"] == 1, "somebody may have mended it"
    client.post("/v1/leases", json=asking(worker=of_group("day_@2", tags=["gpu"])))
    assert told()["unfit"] == 0
    assert client.get("/v1/work?group=").status_code == 422


@pytest.mark.parametrize("other", ["lab-2@pc7-1", "lab-7-4711", "LAB@pc7-1", "labs@pc7-1"])
def test_a_group_is_not_answered_for_by_workers_of_another_that_is_called_much_the_same(
    client: TestClient, other: str
) -> None:
    client.post("/v1/studies", json={**STUDY, "tags": ["gpu"]})
    assert client.post("/v1/leases", json=asking(worker=of_group(other))).status_code == 409
    assert client.get("/v1/work?group=lab").json()["unfit"] == 0
    assert client.post("/v1/leases", json=asking(worker=of_group("lab@pc7-1"))).status_code == 409
    assert client.get("/v1/work?group=lab").json()["unfit"] == 10
