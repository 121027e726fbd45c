"""Why nobody works on a study, told over REST and on the pages."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from server.logic.fleet.hosts import host_class
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
