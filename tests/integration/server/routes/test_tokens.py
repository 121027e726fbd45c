"""Tokens with scopes: who may do what, for how long, and who may no longer even ask."""

import json
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy.engine import Engine

from rehyb.cli import main
from server.errors import BadSettingError, NotFoundError
from server.logic.tokens import FAILURES, Failures, may, scopes_needed
from server.operations import tokens
from server.store.database.engine import reading
from server.store.database.schema import tokens as tokens_table

STUDY = {"name": "n", "model": "ishigami", "method": "morris", "rows": 2}
ASKING = {
    "worker": {"id": "w", "host": "h", "versions": {}},
    "models": ["ishigami"],
    "max_instances": 1,
}


def bearing(app: FastAPI, *scopes: str) -> tuple[str, dict[str, str]]:
    token, secret = tokens.create(app.state.engine, name="n", scopes=scopes, now=1.0)
    return token.id, {"Authorization": f"Bearer {secret}"}


@pytest.mark.parametrize(
    ("method", "path", "scope"),
    [
        ("GET", "/v1/studies", "read"),
        ("GET", "/metrics", "read"),
        ("HEAD", "/v1/studies/a/progress", "read"),
        ("POST", "/v1/studies", "submit"),
        ("DELETE", "/v1/studies/a", "submit"),
        ("POST", "/v1/studies/a/rerun", "submit"),
        ("POST", "/v1/leases", "work"),
        ("POST", "/v1/leases/a/renew", "work"),
        ("POST", "/v1/results", "work"),
        ("POST", "/v1/sessions", "submit"),
        ("DELETE", "/v1/sessions/a", "submit"),
        ("POST", "/v1/sessions/a/close-loop", "submit"),
        ("GET", "/v1/close-loops/a", "read"),
        ("POST", "/v1/close-loops/lease", "work"),
        ("POST", "/v1/close-loops/a/report", "work"),
    ],
)
def test_every_request_needs_one_scope(method: str, path: str, scope: str) -> None:
    needed = scopes_needed(method, path)
    assert needed == (scope,)
    assert may(["admin"], needed)
    assert not may([s for s in ("read", "work", "submit") if s != scope], needed)


def test_a_session_may_be_had_by_who_reads_and_by_who_works() -> None:
    needed = scopes_needed("GET", "/v1/sessions/a/archive")
    assert may(["read"], needed) and may(["work"], needed) and not may(["submit"], needed)


def test_a_token_may_do_what_its_scopes_say_and_is_told_what_it_lacks(
    client: TestClient, app: FastAPI
) -> None:
    _, worker = bearing(app, "work")
    _, reader = bearing(app, "read")
    _, both = bearing(app, "submit", "read")
    assert client.post("/v1/studies", json=STUDY, headers=both).status_code == 201
    assert client.post("/v1/leases", json=ASKING, headers=worker).status_code == 201
    assert client.get("/v1/studies", headers=reader).status_code == 200
    refused = client.post("/v1/studies", json=STUDY, headers=reader)
    assert refused.status_code == 403
    assert refused.json()["detail"] == "this needs a token with the scope submit; yours has read"
    assert client.get("/v1/workers", headers=worker).status_code == 403
    assert client.post("/v1/leases", json=ASKING, headers=both).status_code == 403


def test_a_worker_may_announce_a_model_but_not_upload_one(app: FastAPI, client: TestClient) -> None:
    _, worker = bearing(app, "work")
    _, submitter = bearing(app, "submit")
    zipped = {"Content-Type": "application/zip"}
    refused = client.post("/v1/models", content=b"PK", headers={**worker, **zipped})
    assert refused.status_code == 403
    assert "submit" in refused.json()["detail"]
    understood = client.post("/v1/models", content=b"PK", headers={**submitter, **zipped})
    assert understood.status_code == 422
    # Past the token; it is no description.
    assert client.post("/v1/models", json={}, headers=worker).status_code == 422


def test_a_revoked_token_is_good_for_seconds_only(
    client: TestClient, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("server.http.guards.monotonic", lambda: now[0])
    token_id, headers = bearing(app, "read")
    assert client.get("/v1/studies", headers=headers).status_code == 200
    tokens.revoke(app.state.engine, token_id, now=2.0)
    now[0] += 5.1
    assert client.get("/v1/studies", headers=headers).status_code == 401


def test_who_sent_a_token_is_told_that_it_is_refused_and_who_sent_none_how_to(
    client: TestClient, app: FastAPI
) -> None:
    token_id, revoked = bearing(app, "read")
    tokens.revoke(app.state.engine, token_id, now=2.0)

    def told(**headers: str) -> str:
        client.headers.pop("Authorization", None)
        answer = client.get("/v1/studies", headers=headers)
        assert answer.status_code == 401 and answer.headers["WWW-Authenticate"] == "Bearer"
        return str(answer.json()["detail"])

    refused = told(Authorization="Bearer made-up")
    assert "refused: it is unknown or revoked" in refused and "`rehyb token create" in refused
    # Whoever tries some learns of none that it was good once.
    assert told(**revoked) == refused
    for nothing in ({}, {"Authorization": "Bearer "}, {"Authorization": "Basic bWU6bXk="}):
        assert told(**nothing).startswith("send the header `Authorization: Bearer TOKEN`")


def test_guessing_is_cut_short_and_harms_nobody_who_knows(
    client: TestClient, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("server.http.guards.monotonic", lambda: now[0])
    _, good = bearing(app, "read")
    assert client.get("/v1/studies", headers=good).status_code == 200
    wrong = {"Authorization": "Bearer guess"}
    answers = [client.get("/v1/studies", headers=wrong).status_code for _ in range(FAILURES + 2)]
    assert answers == [401] * FAILURES + [429] * 2
    assert client.get("/v1/studies", headers=wrong).headers["retry-after"] == "60"
    now[0] += 10.0
    assert client.get("/v1/studies", headers=good).status_code == 200
    _, unknown = bearing(app, "read")
    assert client.get("/v1/studies", headers=unknown).status_code == 429
    assert client.get("/v1/studies").status_code == 200, "the operator's own token"
    now[0] += 61.0
    assert client.get("/v1/studies", headers=wrong).status_code == 401


def test_failures_are_forgotten_after_a_while() -> None:
    failures = Failures()
    for second in range(FAILURES):
        assert not failures.too_many("a", float(second))
        failures.count("a", float(second))
    assert failures.too_many("a", 30.0)
    assert not failures.too_many("b", 30.0)
    assert not failures.too_many("a", 61.0)


def test_the_database_holds_no_secret(engine: Engine) -> None:
    token, secret = tokens.create(engine, name="lab", scopes=["work", "work"], now=1.0)
    assert token.scopes == ("work",)
    with reading(engine) as connection:
        stored = repr(connection.execute(sa.select(tokens_table)).all())
    assert secret not in stored
    assert tokens.good(engine, secret.encode()) == tokens.good(engine, token.id) == token
    # Neither is taken for the other.
    for other in (b"\xff other", secret, token.id.encode()):
        assert tokens.good(engine, other) is None


def test_wrong_scopes_and_ids_are_refused(engine: Engine) -> None:
    with pytest.raises(BadSettingError, match="there is no scope 'root': take submit, work"):
        tokens.create(engine, name="n", scopes=["root"], now=1.0)
    with pytest.raises(BadSettingError, match="a token needs a scope"):
        tokens.create(engine, name="n", scopes=[], now=1.0)
    for name in ("", " ", "a\nb", "a\x1bb", "n" * 129):
        with pytest.raises(BadSettingError, match="a token's name is a line of 1 to 128 char"):
            tokens.create(engine, name=name, scopes=["work"], now=1.0)
    with pytest.raises(NotFoundError, match="rehyb token list"):
        tokens.revoke(engine, "nothing", now=1.0)


def test_tokens_are_made_listed_and_revoked_by_command(
    url: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: str) -> Any:
        monkeypatch.setenv("REHYB_DATABASE_URL", url)
        monkeypatch.setattr("sys.argv", ["rehyb", *arguments, "--json"])
        with pytest.raises(SystemExit) as leaving:
            main()
        assert not leaving.value.code
        return json.loads(capsys.readouterr().out)

    run("db", "upgrade")
    made = run("token", "create", "lab-pc", "--scope", "work")
    assert (made["name"], made["scopes"]) == ("lab-pc", ["work"])
    assert made["token"].startswith("rehyb_")
    assert [token["id"] for token in run("token", "list")["tokens"]] == [made["id"]]
    assert run("token", "revoke", made["id"])["revoked_at"] is not None
