"""Sessions over REST: kept once, given back as they came, refused without a trace."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy.engine import Engine

from server.errors import BadFileError, NotFoundError
from server.operations import check, sessions
from server.store.database.engine import reading, writing
from server.store.database.parts import PART_BYTES
from server.store.database.schema import metadata, session_parts
from tests.testbed.coordinators.rest_bodies import is_problem

ZIP = {"Content-Type": "application/zip"}
CONTENT: dict[str, Any] = {
    "model": "device.xml",
    "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}],
    "trials": [{"file": "a.csv", "role": "fit", "seconds": 10.0}],
}


@pytest.fixture(autouse=True)
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stand in for the process that looks at sessions; returns the names of those it was given."""
    given: list[str] = []

    async def look(_program: str, file: Path) -> dict[str, Any]:
        given.append(file.name)
        if file.read_bytes().startswith(b"bad"):
            raise BadFileError("a.csv, column time, line 3: no", file="a.csv", column="time")
        return CONTENT

    monkeypatch.setattr("server.routes.sessions.check", look)
    return given


def rows(engine: Engine) -> int:
    """Return how many rows all tables of the database have."""
    with reading(engine) as connection:
        return sum(
            connection.scalar(sa.select(sa.func.count()).select_from(table)) or 0
            for table in metadata.tables.values()
        )


def test_a_session_is_kept_and_shown_as_it_was_understood(client: TestClient) -> None:
    answer = client.post("/v1/sessions?name=monday", content=b"PK1", headers=ZIP)
    assert answer.status_code == 201
    kept = answer.json()
    assert answer.headers["location"] == f"/v1/sessions/{kept['id']}"
    assert kept | CONTENT == kept
    assert (kept["name"], kept["size"]) == ("monday", 3)
    assert kept["sha256"] == hashlib.sha256(b"PK1").hexdigest()
    assert client.get(f"/v1/sessions/{kept['id']}").json() == kept
    assert client.get("/v1/sessions").json() == {"sessions": [kept]}


def test_the_same_bytes_are_the_same_session_and_are_looked_at_once(
    client: TestClient, looked_at: list[str]
) -> None:
    first = client.post("/v1/sessions?name=monday", content=b"PK1", headers=ZIP)
    again = client.post("/v1/sessions?name=tuesday", content=b"PK1", headers=ZIP)
    assert (again.status_code, again.json()) == (200, first.json())
    assert looked_at == ["monday.zip"]
    other = client.post("/v1/sessions", content=b"PK2", headers=ZIP)
    assert other.status_code == 201 and other.json()["id"] != first.json()["id"]


def test_a_session_may_come_as_the_file_of_a_form(client: TestClient) -> None:
    answer = client.post("/v1/sessions", files={"file": ("C:\\logs\\monday.zip", b"PK1")})
    assert (answer.status_code, answer.json()["name"]) == (201, "monday")
    assert client.get(f"/v1/sessions/{answer.json()['id']}/archive").content == b"PK1"
    problem = is_problem(client.post("/v1/sessions", files={"file": (None, "text")}), 422)
    assert "no file" in problem["detail"]
    two = {"file": ("a.zip", b"PK1"), "other": ("b.zip", b"PK1")}
    is_problem(client.post("/v1/sessions", files=two), 400)


def test_a_large_archive_comes_back_as_it_was(client: TestClient, app: FastAPI) -> None:
    content = bytes(range(256)) * (PART_BYTES // 256) * 2 + b"end"
    kept = client.post("/v1/sessions", content=content, headers=ZIP).json()
    answer = client.get(f"/v1/sessions/{kept['id']}/archive")
    assert answer.content == content
    assert answer.headers["content-length"] == str(len(content))
    with reading(app.state.engine) as connection:
        assert connection.scalar(sa.select(sa.func.count()).select_from(session_parts)) == 3


def test_a_bad_session_is_one_problem_and_leaves_nothing(client: TestClient, app: FastAPI) -> None:
    before = rows(app.state.engine)
    problem = is_problem(client.post("/v1/sessions", content=b"bad", headers=ZIP), 422)
    assert problem["detail"] == "a.csv, column time, line 3: no"
    assert (problem["file"], problem["column"], problem["line"]) == ("a.csv", "time", None)
    assert rows(app.state.engine) == before


@pytest.mark.parametrize("form", [False, True], ids=["body", "form"])
@pytest.mark.parametrize("announced", [True, False], ids=["announced", "in pieces"])
def test_too_large_a_session_is_refused(
    client: TestClient, app: FastAPI, looked_at: list[str], form: bool, announced: bool
) -> None:
    limit = app.state.settings.session_bytes
    assert limit == 3_000_000
    before = rows(app.state.engine)
    content = bytes(limit + 1)
    if form:
        start = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.zip"\r\n\r\n'
        content = start + content + b"\r\n--x--\r\n"
    kind = "multipart/form-data; boundary=x" if form else "application/zip"

    def pieces() -> Iterator[bytes]:
        yield content[:2_000_000]
        yield content[2_000_000:]

    sent = content if announced else pieces()
    answer = client.post("/v1/sessions", content=sent, headers={"Content-Type": kind})
    assert "REHYB_SESSION_BYTES" in is_problem(answer, 413)["detail"]
    assert rows(app.state.engine) == before and not looked_at


FORM = (
    b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.zip"\r\n\r\nPK1\r\n--x--\r\n'
)


@pytest.mark.parametrize("path", ["/v1/sessions", "/v1/models", "/v1/analyses"])
def test_a_form_that_was_cut_off_is_called_that(client: TestClient, path: str) -> None:
    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    for cut in (0, 1, 30, FORM.index(b"PK1") + 1, FORM.rindex(b"--x--") + 4):
        answer = client.post(path, content=FORM[:cut], headers=headers)
        assert is_problem(answer, 400)["detail"] == (
            "the form was cut off: its closing boundary is missing; send the whole of it again"
        )


def test_a_form_of_another_encoding_is_refused(client: TestClient) -> None:
    kind = "multipart/form-data; boundary=x; charset="
    # The last ones are known to Python, and no encoding of texts.
    for charset in ("utf-16", "latin-1", "nonsense", "punycode", "undefined"):
        headers = {"Content-Type": kind + charset}
        answer = client.post("/v1/sessions", content=FORM, headers=headers)
        said = f"says charset={charset}: send its names in UTF-8"
        assert said in is_problem(answer, 415)["detail"]
    answer = client.post("/v1/sessions", content=FORM, headers={"Content-Type": f"{kind}UTF-8"})
    assert answer.status_code == 201


def test_a_session_of_the_largest_size_is_taken(client: TestClient, app: FastAPI) -> None:
    content = bytes(app.state.settings.session_bytes)
    assert client.post("/v1/sessions", content=content, headers=ZIP).status_code == 201


def test_other_requests_keep_their_own_limit(client: TestClient) -> None:
    for path in ("/v1/sessions/a/close-loop", "/v1/results"):
        answer = client.post(path, content=b" " * (8 * 1024 * 1024 + 1))
        said = "a request may have 8388608 bytes at most"
        if path == "/v1/results":
            said += ": post results in smaller batches"
        assert is_problem(answer, 413)["detail"] == said


def test_a_deleted_session_is_gone_with_its_parts(client: TestClient, app: FastAPI) -> None:
    before = rows(app.state.engine)
    kept = client.post("/v1/sessions", content=b"PK1", headers=ZIP).json()
    path = f"/v1/sessions/{kept['id']}"
    assert client.delete(path).status_code == 204
    for answer in (client.get(path), client.get(f"{path}/archive"), client.delete(path)):
        is_problem(answer, 404)
    assert rows(app.state.engine) == before


@pytest.mark.parametrize("name", ["", "a/b", "a\\b", "x" * 61, "a\x00", "a\u202eb"])
def test_a_name_that_names_no_file_is_refused(client: TestClient, name: str) -> None:
    answer = client.post("/v1/sessions", params={"name": name}, content=b"PK1", headers=ZIP)
    assert is_problem(answer, 422)["pointer"] == "/query/name"


def test_who_reads_an_archive_that_is_deleted_meanwhile_is_told(client: TestClient) -> None:
    content = bytes(2 * PART_BYTES)
    kept = client.post("/v1/sessions", content=content, headers=ZIP).json()
    engine: Engine = client.app.state.engine  # type: ignore[attr-defined]
    reader = sessions.archive(engine, sessions.get(engine, kept["id"]))
    next(reader)
    sessions.delete(engine, kept["id"])
    with pytest.raises(NotFoundError, match="deleted"):
        next(reader)


def test_the_check_of_a_database_looks_at_sessions(client: TestClient, app: FastAPI) -> None:
    kept = client.post("/v1/sessions", content=b"PK1", headers=ZIP).json()
    assert check.faults(app.state.engine) == []
    with writing(app.state.engine) as connection:
        connection.execute(sa.update(session_parts).values(content=b"PK3"))
    (fault,) = check.faults(app.state.engine)
    assert fault == f"session {kept['id']}: its file is not the one that was uploaded"
