"""What stands before every route."""

from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from starlette.types import Message

from server.http.guards import MAX_BODY_BYTES
from server.store.database.engine import writing

JSON = {"Content-Type": "application/json"}


NO_TOKENS = [
    None,
    "",
    "Bearer",
    "Bearer ",
    "Bearer wrong",
    "Bearer correct-horse battery",
    "Basic correct-horse",
    "correct-horse",
    "Bearer pässword".encode(),
]


@pytest.mark.parametrize("path", ["/v1/studies", "/v1/nothing", "/v1"])
def test_without_the_token_nothing_under_v1_answers(client: TestClient, path: str) -> None:
    client.headers.pop("Authorization")
    for header in NO_TOKENS:
        headers = {} if header is None else {"Authorization": header}
        response = client.get(path, headers=headers)  # type: ignore[arg-type]
        assert response.status_code == 401, header
        assert response.headers["www-authenticate"] == "Bearer"
        assert response.headers["content-type"] == "application/problem+json"


def test_what_the_coordinator_can_do_is_told_to_those_with_a_token_only(client: TestClient) -> None:
    assert client.get("/openapi.json").status_code == 200
    assert client.get("/openapi.json", headers={"Authorization": ""}).status_code == 401


def test_a_body_is_not_read_before_the_token_is(client: TestClient) -> None:
    client.headers.pop("Authorization")
    response = client.post("/v1/studies", content="not JSON", headers=JSON)
    assert response.status_code == 401


def test_the_scheme_s_name_may_be_in_any_case(client: TestClient) -> None:
    response = client.get("/v1/studies", headers={"Authorization": "bearer correct-horse"})
    assert response.status_code == 200


def test_supervisors_need_no_token(client: TestClient, app: FastAPI) -> None:
    client.headers.pop("Authorization")
    assert client.get("/healthz").json() == {"status": "ok"}
    assert client.get("/readyz").json() == {"status": "ready"}
    with writing(app.state.engine) as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    assert client.get("/healthz").status_code == 200
    assert client.get("/readyz").status_code == 503
    assert "newer version" in client.get("/readyz").json()["detail"]


@pytest.mark.parametrize("kind", [b"application/zip", b"multipart/form-data; boundary=x", b""])
@pytest.mark.parametrize(
    "path", ["/v1/results", "/v1/sessions", "/v1/models", "/v1/analyses", "/v1/studies"]
)
def test_who_leaves_in_the_middle_of_a_body_is_no_failure_of_the_coordinator(
    client: TestClient, app: FastAPI, path: str, kind: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    sent: list[Message] = []
    begun: list[Message] = [{"type": "http.request", "body": b"--x\r\nC", "more_body": True}]

    async def receive() -> Message:
        return begun.pop() if begun else {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message)

    head = [(b"authorization", b"Bearer correct-horse"), (b"content-type", kind)]
    scope = {"type": "http", "method": "POST", "path": path, "query_string": b""}
    assert client.portal is not None
    client.portal.call(app, {**scope, "headers": head}, receive, send)
    assert sent[0]["status"] == 400
    assert "failed" not in caplog.text


def test_a_body_that_says_it_is_too_large_is_refused(client: TestClient) -> None:
    response = client.post("/v1/results", content=b" " * (MAX_BODY_BYTES + 1), headers=JSON)
    assert response.status_code == 413
    assert response.headers["content-type"] == "application/problem+json"


def test_a_body_that_turns_out_too_large_is_refused(client: TestClient) -> None:
    def unannounced() -> Iterator[bytes]:
        for _ in range(9):
            yield b" " * (1024 * 1024)

    response = client.post("/v1/results", content=unannounced(), headers=JSON)
    assert response.status_code == 413
    assert response.headers["content-type"] == "application/problem+json"


def test_a_body_nested_too_deeply_is_refused(client: TestClient) -> None:
    response = client.post("/v1/results", content="[" * 100_000, headers=JSON)
    assert 400 <= response.status_code < 500
    assert response.headers["content-type"] == "application/problem+json"
