"""Studies in a list: in short, and a page at a time."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.testbed.coordinators.rest_bodies import STUDY, faults_of


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_studies_are_listed_in_short_and_in_pages(client: TestClient, clock: Any) -> None:
    made = []
    for number in range(5):
        clock.now += number // 2
        body = {**STUDY, "name": f"study {number}", "tags": ["lab"]}
        made.append(client.post("/v1/studies", json=body).json())
    short = (
        *("id", "name", "model", "method", "sampling", "rows", "seed"),
        *("state", "instances", "created_at", "priority", "tags"),
    )
    rows = [{name: study[name] for name in short} for study in made]
    rows.sort(key=lambda row: (row["created_at"], row["id"]))
    assert client.get("/v1/studies").json() == {"studies": rows, "next": None}
    first = client.get("/v1/studies?limit=2").json()
    second = client.get("/v1/studies", params={"limit": 2, "after": first["next"]}).json()
    client.post(f"/v1/studies/{second['studies'][-1]['id']}/cancel")
    assert client.delete(f"/v1/studies/{second['studies'][-1]['id']}").status_code == 204
    last = client.get("/v1/studies", params={"limit": 2, "after": second["next"]}).json()
    assert first["studies"] + second["studies"] + last["studies"] == rows
    assert last["next"] is None
    assert faults_of(client.get("/v1/studies?after=yesterday"))[0][0] == "/query/after"
