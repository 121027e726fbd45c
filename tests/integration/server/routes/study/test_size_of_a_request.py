"""How much one request for a study may hold, and that a refusal stays short."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.testbed.coordinators.rest_bodies import STUDY, Json, is_problem


def _drawn_from(count: int) -> Json:
    values = list(range(count))
    discrete = {"kind": "discrete", "values": values, "probabilities": [1 / count] * count}
    return {**STUDY, "factors": [{"name": "x1", "distribution": discrete}], "outside_range": True}


@pytest.mark.parametrize("kind", ["sqlite"])
def test_a_discrete_distribution_has_a_thousand_values_at_most(client: TestClient) -> None:
    assert client.post("/v1/studies", json=_drawn_from(1000)).status_code == 201
    problem = is_problem(client.post("/v1/studies", json=_drawn_from(1001)), 422)
    assert problem["pointer"].startswith("/factors/0/distribution/")
    assert problem["detail"] == (
        "a discrete distribution may have 1000 values at most, not 1001: merge those that lie "
        "close, or give the distribution that they are drawn from"
    )


@pytest.mark.parametrize("kind", ["sqlite"])
@pytest.mark.parametrize(
    ("part", "pointer"),
    [
        ({"outputs": [1] * 300_000}, "/outputs"),
        ({"factors": [1] * 300_000}, "/factors"),
        ({"fixed": {f"k{i}": None for i in range(50_000)}}, "/fixed"),
        ({"groups": {"a/b": ["x1"] * 10_001}}, "/groups/a~1b"),
        ({f"k{i}": 1 for i in range(50_000)}, ""),
        ({f"k{i}": [1] * 9_999 for i in range(11)}, ""),
    ],
)
def test_what_holds_more_than_any_study_is_refused_in_one_sentence(
    client: TestClient, part: Any, pointer: str
) -> None:
    response = client.post("/v1/studies", json={**STUDY, **part})
    problem = is_problem(response, 422)
    assert problem["pointer"] == pointer and "entries at most" in problem["detail"]
    assert len(response.content) < 1000


@pytest.mark.parametrize("kind", ["sqlite"])
def test_of_many_faults_the_first_hundred_are_told(client: TestClient) -> None:
    problem = is_problem(client.post("/v1/studies", json={**STUDY, "outputs": [1] * 250}), 422)
    assert len(problem["errors"]) == 100
    assert problem["detail"].endswith(": the first 100 faults, and there are 150 more")


@pytest.mark.parametrize("kind", ["sqlite"])
def test_a_long_body_with_a_key_twice_is_refused_too(client: TestClient) -> None:
    twice = json.dumps({**STUDY, "name": "a" * 150}) + " " * 200_000
    body = twice.replace('"name"', '"rows": 1, "name"', 1)
    headers = {"Content-Type": "application/json"}
    problem = is_problem(client.post("/v1/studies", content=body, headers=headers), 422)
    assert "comes twice" in problem["detail"]


@pytest.mark.parametrize("kind", ["sqlite"])
def test_what_ends_amid_a_key_that_comes_twice_is_no_json(client: TestClient) -> None:
    headers = {"Content-Type": "application/json"}
    answer = client.post("/v1/studies", content='{"a": {"b": 1, "b": 2}', headers=headers)
    assert "is not JSON" in is_problem(answer, 422)["detail"]
