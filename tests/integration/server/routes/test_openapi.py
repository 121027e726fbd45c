"""The OpenAPI document shows an example of every request, and the examples are good ones."""

from typing import Any

from fastapi.testclient import TestClient

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
