"""What a route does not know of a query, and a body where it has none, is not ignored."""

import gzip

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from fastapi.testclient import TestClient

from server.routes.common import Route
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, faults_of, is_problem

SAID = "no such query parameter: this route knows "


def test_every_route_of_the_interface_refuses_what_it_does_not_know(app: FastAPI) -> None:
    described = [one for one in app.routes if isinstance(one, APIRoute) and one.include_in_schema]
    assert len(described) > 40
    assert [one.path for one in described if not isinstance(one, Route)] == []


@pytest.mark.parametrize(
    ("method", "path", "unknown", "known"),
    [
        (
            "GET",
            "/v1/studies/s/instances?state=failed&sate=failed",
            ["sate"],
            "state, outcome, after, limit, replay",
        ),
        ("GET", "/v1/work?Group=a&x", ["Group", "x"], "group"),
        ("GET", "/v1/sessions?limit=1", ["limit"], "none"),
        # Those that workers ask for all the time are called without FastAPI.
        ("POST", "/v1/leases?x=1", ["x"], "none"),
        ("POST", "/v1/results?x=1", ["x"], "none"),
        ("POST", "/v1/studies?rows=2", ["rows"], "none"),
        ("POST", "/v1/studies/s/analyses?factor=x1", ["factor"], "output"),
        ("GET", "/metrics?name[]=a", ["name[]"], "none"),
        ("GET", "/healthz?x=1", ["x"], "none"),
        ("POST", "/v1/sign-in-codes?next=a", ["next"], "none"),
    ],
)
def test_an_unknown_name_is_named_with_those_that_are_known(
    client: TestClient, method: str, path: str, unknown: list[str], known: str
) -> None:
    refused = client.request(method, path)
    assert faults_of(refused) == [(f"/query/{name}", SAID + known) for name in unknown]


@pytest.mark.parametrize(
    ("method", "path", "twice"),
    [
        ("GET", "/v1/work?group=a&group=b", "group"),
        ("GET", "/v1/studies/s/instances?state=failed&limit=1&limit=2", "limit"),
    ],
)
def test_a_name_that_comes_twice_is_refused_where_one_value_is_wanted(
    client: TestClient, method: str, path: str, twice: str
) -> None:
    said = "comes twice, and is one value: leave out one"
    assert faults_of(client.request(method, path)) == [(f"/query/{twice}", said)]
    table = "a,b,y\n" + "".join(f"{n % 7},{n % 11},{n % 13}\n" for n in range(80))
    several = client.post(
        "/v1/analyses?output=y&output=a&factor=b",
        content=table,
        headers={"Content-Type": "text/csv"},
    )
    assert "comes twice" not in several.text


@pytest.mark.parametrize(
    ("path", "body", "where", "known"),
    [
        ("/v1/studies/s/precision", {"upto": 9}, "/upto", "output, target, up_to"),
        (
            "/v1/studies",
            {**STUDY, "precision": {"to": 1}},
            "/precision/to",
            "output, target, up_to",
        ),
        ("/v1/leases", asking(max=1), "/max", "worker, models, max_instances, at_most"),
        (
            "/v1/leases",
            asking(worker={"id": "w", "host": "h", "name": "n"}),
            "/worker/name",
            "id, host, versions, tags, canaries, refused",
        ),
    ],
)
def test_of_an_unknown_key_those_that_are_known_are_told(
    client: TestClient, path: str, body: Json, where: str, known: str
) -> None:
    faults = dict(faults_of(client.post(path, json=body)))
    assert faults[where] == f"is not known here: there are {known}"


def test_what_is_known_is_taken_and_a_wrong_method_stays_one(client: TestClient) -> None:
    assert client.get("/v1/work?group=a").status_code == 200
    assert client.get("/v1/models?wanted=true").status_code == 200
    assert client.put("/v1/studies?x=1").status_code == 405


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("DELETE", "/v1/studies", "GET, HEAD, POST"),
        ("OPTIONS", "/v1/studies", "GET, HEAD, POST"),
        ("PATCH", "/v1/studies/s", "DELETE, GET, HEAD"),
        ("GET", "/v1/studies/s/precision", "DELETE, POST"),
        ("GET", "/v1/results", "POST"),
        ("POST", "/healthz", "GET, HEAD"),
        ("HEAD", "/v1/results", "POST"),
    ],
)
def test_a_wrong_method_is_told_all_that_are_right(
    client: TestClient, method: str, path: str, allowed: str
) -> None:
    refused = client.request(method, path)
    assert (refused.status_code, refused.headers["allow"]) == (405, allowed)


@pytest.mark.parametrize("kind", ["sqlite"])
def test_nobody_is_sent_to_a_host_that_a_request_names(client: TestClient) -> None:
    answer = client.get("/v1/studies/", headers={"Host": "evil"}, follow_redirects=False)
    assert (answer.status_code, answer.headers.get("location")) == (404, None)


def test_pages_ignore_what_they_do_not_know(client: TestClient) -> None:
    assert client.get("/sign-in?next=%2F&x=1").status_code == 200
    assert client.get("/?x=1").status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "known"),
    [
        ("POST", "/v1/studies/s/analyses", "; say in the query: output"),
        ("POST", "/v1/studies/s/cancel", ""),
        ("DELETE", "/v1/studies/s", ""),
        ("GET", "/v1/studies", "; say in the query: after, limit"),
        ("GET", "/v1/work", "; say in the query: group"),
        ("POST", "/v1/sign-in-codes", ""),
    ],
)
def test_a_body_is_refused_where_there_is_none(
    client: TestClient, method: str, path: str, known: str
) -> None:
    why = f"this route takes no body{known}"
    for body in (b'{"output": "zz"}', b"[]", b"output=y"):
        assert faults_of(client.request(method, path, content=body)) == [("", why)]
    packed = {"Content-Encoding": "gzip"}
    if method != "GET":
        refused = client.request(method, path, content=gzip.compress(b"[1]"), headers=packed)
        assert faults_of(refused) == [("", why)]


@pytest.mark.parametrize("body", [b"", b"{}", b" { }\n", b"null"])
def test_a_body_that_says_nothing_is_none(client: TestClient, body: bytes) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    headers = {"Content-Type": "application/json"}
    for action in ("pause", "resume", "cancel"):
        done = client.post(f"/v1/studies/{study}/{action}", content=body, headers=headers)
        assert done.status_code == 200
    assert client.request("GET", "/v1/studies", content=body, headers=headers).status_code == 200
    deleted = client.request("DELETE", f"/v1/studies/{study}", content=body, headers=headers)
    assert deleted.status_code == 204


@pytest.mark.parametrize("kind", ["sqlite"])
def test_where_there_is_nothing_it_is_said_where(client: TestClient) -> None:
    for path in ("/v1/nothing", "/v1/studies/s/", "/docs", "/static/none.css"):
        said = is_problem(client.get(path), 404)["detail"]
        assert said == f"there is nothing at {path}; GET /openapi.json tells what there is"
    said = is_problem(client.delete("/v1/studies"), 405)["detail"]
    assert said == "/v1/studies takes GET, HEAD, POST, not DELETE"
    assert len(is_problem(client.get("/v1/" + "x" * 5000), 404)["detail"]) < 300
