"""The OpenAPI document shows an example of every request, and the examples are good ones."""

import json
from typing import Any

from fastapi.testclient import TestClient
from jsonschema_rs import Draft202012Validator

from server.http.document import PROBLEM
from tests.testbed.coordinators.rest_bodies import is_problem

Json = dict[str, Any]


def example(schema: Json, document: Json) -> Any:
    """Return the first example of a schema, wherever it is written."""
    reference = schema.get("$ref", "")
    if reference:
        schema = document["components"]["schemas"][reference.rsplit("/", 1)[-1]]
    assert schema.get("examples"), schema
    return schema["examples"][0]


def requests(document: Json) -> list[tuple[str, str, Json]]:
    """Return method, path and what else goes along, for every request that is described."""
    found = []
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            given: Json = {"params": {}, "headers": {}}
            url = path
            for parameter in operation.get("parameters", []):
                value, name = example(parameter["schema"], document), parameter["name"]
                if parameter["in"] == "path":
                    url = url.replace(f"{{{name}}}", str(value))
                else:
                    given["params" if parameter["in"] == "query" else "headers"][name] = value
            if "requestBody" in operation:
                kind, body = next(iter(operation["requestBody"]["content"].items()))
                shown = example(body["schema"], document)
                given["json" if kind == "application/json" else "content"] = shown
                given["headers"]["Content-Type"] = kind
            found.append((method.upper(), url, given))
    return found


def test_every_request_has_an_example_that_the_coordinator_understands(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    described = requests(document)
    assert len(described) > 20
    assert not [url for _, url, _ in described if "{" in url]
    for method, url, given in described:
        answer = client.request(method, url, **given)
        # The study or lease of the example is not there; but nobody says that it is nonsense.
        # Only archives and tables of enough rows cannot be written down as an example.
        long = ("/v1/sessions", "/v1/analyses")
        known = (200, 422) if url in long else (200, 201, 204, 404, 409)
        assert answer.status_code in known, f"{method} {url}: {answer.text}"


def test_the_example_of_a_study_can_be_submitted_and_its_work_leased(client: TestClient) -> None:
    given = {
        (method, url): body for method, url, body in requests(client.get("/openapi.json").json())
    }
    assert client.post("/v1/studies", **given["POST", "/v1/studies"]).status_code == 201
    lease = client.post("/v1/leases", **given["POST", "/v1/leases"])
    assert lease.status_code == 201
    assert len(lease.json()["instances"]) == 4


def test_every_operation_says_that_it_refuses_with_a_problem(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    assert "ValidationError" not in json.dumps(document)
    problem = {"$ref": "#/components/responses/Problem"}
    for methods in document["paths"].values():
        for operation in methods.values():
            assert operation["responses"]["4XX"] == operation["responses"]["5XX"] == problem
            assert "422" not in operation["responses"]
    described = document["components"]["responses"]["Problem"]["content"]
    assert list(described) == ["application/problem+json"]
    results = document["paths"]["/v1/results"]["post"]["responses"]
    assert list(results["409"]["content"]) == ["application/json"]


def test_refusals_are_as_the_document_says(client: TestClient) -> None:
    check = Draft202012Validator(PROBLEM).validate
    study = {"name": "n", "model": "ishigami", "method": "morris"}
    known = set(PROBLEM["properties"])
    for status, asked in (
        (401, {"headers": {"Authorization": ""}}),
        (415, {"content": b"{}"}),
        # One fault, whoever finds it, and several.
        (422, {"json": {**study, "rows": 0}}),
        (422, {"json": {**study, "rows": "2"}}),
        (422, {"json": {**study, "rows": "2", "seed": -1}}),
    ):
        answer = is_problem(client.post("/v1/studies", **asked), status)
        check(answer)
        assert set(answer) <= known
        assert ("pointer" in answer or "errors" in answer) == (status == 422)
    for answer in (
        client.get("/v1/studies/none"),
        client.put("/v1/studies"),
        client.post("/v1/sessions", content=b"no zip file"),
    ):
        check(is_problem(answer, answer.status_code))
        assert set(answer.json()) <= known
