"""HEAD is served wherever GET is, and has no body."""

import pytest
from fastapi.testclient import TestClient

from tests.testbed.coordinators.rest_bodies import STUDY


@pytest.mark.parametrize("kind", ["sqlite"])
@pytest.mark.parametrize(
    "path",
    [
        "/healthz",
        "/v1/studies",
        "/v1/studies/{}",
        "/v1/studies/{}/results.csv",
        # Of which GET never comes to an end.
        "/v1/studies/{}/events",
        "/",
        "/v1/studies/none",
    ],
)
def test_head_answers_as_get_does_without_a_body(client: TestClient, path: str) -> None:
    where = path.format(client.post("/v1/studies", json=STUDY).json()["id"])
    answer = client.head(where)
    assert answer.content == b""
    if path.endswith("events"):
        assert answer.headers["content-type"].startswith("text/event-stream")
        return
    got = client.get(where)
    assert answer.status_code == got.status_code
    assert answer.headers["content-type"] == got.headers["content-type"]


@pytest.mark.parametrize("kind", ["sqlite"])
def test_a_stranger_hears_no_more_of_head_than_of_get(client: TestClient) -> None:
    assert client.head("/v1/studies", headers={"Authorization": "Bearer x"}).status_code == 401
