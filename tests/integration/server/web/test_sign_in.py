"""Signing in: who may, what a cookie is good for, and what no other site can do with it."""

import re
from collections.abc import Callable, Iterator

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.logic.signing_in import SIGNED_IN_SECONDS
from server.logic.tokens import FAILURES
from server.operations import tokens
from server.settings import Settings
from server.web import assets
from tests.testbed.clock import Clock

HERE = {"Origin": "http://testserver"}
BROWSER = {"Accept": "text/html,*/*"}
STUDY = {"name": "s", "model": "ishigami", "method": "morris", "rows": 4}


@pytest.fixture
def kind() -> str:
    """Of database: what is tested here is not in one."""
    return "sqlite"


@pytest.fixture
def browser(app: FastAPI) -> Iterator[TestClient]:
    """A browser that has not signed in."""
    with TestClient(app, follow_redirects=False) as client:
        yield client


def sign_in(browser: TestClient, token: str = "correct-horse") -> None:
    assert browser.post("/sign-in", json={"token": token}, headers=HERE).status_code == 204


def test_a_stranger_sees_the_page_to_sign_in_at_and_nothing_else(browser: TestClient) -> None:
    answer = browser.get("/studies/1?output=y&x=a b", headers=BROWSER)
    assert answer.status_code == 303
    assert answer.headers["location"] == "/sign-in?next=%2Fstudies%2F1%3Foutput%3Dy%26x%3Da%2520b"
    for path in ("/live/", "/nothing", "/v1/studies", "/openapi.json", "/metrics", "/docs"):
        assert browser.get(path).status_code == 401, path
    assert browser.get("/sign-in", headers=BROWSER).status_code == 200


def test_a_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(
    browser: TestClient,
) -> None:
    answer = browser.post("/sign-in", json={"token": " correct-horse "}, headers=HERE)
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and "correct" not in cookie
    page = browser.get("/", headers=BROWSER)
    assert page.status_code == 200
    policy = page.headers["content-security-policy"]
    assert "default-src 'self'" in policy and "script-src" not in policy
    # No script in the page itself, so none that somebody put there is run.
    assert not re.search(r"<script(?![^>]*\bsrc=)|\son\w+=", page.text)
    assert browser.get("/v1/studies").json() == {"studies": [], "next": None}


@pytest.mark.parametrize("origin", [None, "http://elsewhere", "http://testserver:81", "null"])
def test_another_site_can_neither_change_anything_nor_sign_anybody_in_or_out(
    browser: TestClient, origin: str | None
) -> None:
    sign_in(browser)
    headers = {} if origin is None else {"Origin": origin}
    for path, body in (
        ("/v1/studies", STUDY),
        ("/sign-in", {"token": "correct-horse"}),
        ("/sign-out", None),
    ):
        answer = browser.post(path, json=body, headers=headers)
        assert answer.status_code == 403, path
        assert "set-cookie" not in answer.headers
    assert browser.post("/v1/studies", json=STUDY, headers=HERE).status_code == 201


def test_a_code_signs_in_once_with_the_rights_of_whoever_asked_for_it(
    browser: TestClient, engine: Engine
) -> None:
    _, secret = tokens.create(engine, name="anna", scopes=["read"], now=1.0)
    bearer = {"Authorization": f"Bearer {secret}"}
    code = browser.post("/v1/sign-in-codes", headers=bearer).json()["code"]
    assert browser.post("/sign-in", json={"code": code}, headers=HERE).status_code == 204
    assert browser.get("/", headers=BROWSER).status_code == 200
    assert browser.post("/v1/studies", json=STUDY, headers=HERE).status_code == 403
    again = browser.post("/sign-in", json={"code": code}, headers=HERE)
    assert again.status_code == 401
    assert "used already" in again.json()["detail"]


@pytest.mark.parametrize("scope", ["work", "submit"])
def test_who_may_not_look_at_pages_gets_no_code(
    browser: TestClient, engine: Engine, scope: str
) -> None:
    _, secret = tokens.create(engine, name="w", scopes=[scope], now=1.0)
    asked = browser.post("/v1/sign-in-codes", headers={"Authorization": f"Bearer {secret}"})
    assert asked.status_code == 403
    assert asked.json()["detail"] == f"this needs a token with the scope read; yours has {scope}"


def test_a_code_of_one_coordinator_signs_in_at_any_other_once(
    upgraded_database: Callable[[], str],
) -> None:
    url = upgraded_database()
    apps = [create_app(Settings(database_url=url, token=SecretStr("t"))) for _ in range(2)]
    bearer = {"Authorization": "Bearer t"}
    with TestClient(apps[0]) as here, TestClient(apps[1]) as there:
        for maker, asked in ((here, there), (there, here)):
            code = maker.post("/v1/sign-in-codes", headers=bearer).json()["code"]
            assert asked.post("/sign-in", json={"code": code}, headers=HERE).status_code == 204
            # The cookie is good for both.
            maker.cookies = asked.cookies
            assert maker.get("/", headers=BROWSER).status_code == 200
            again = maker.post("/sign-in", json={"code": code}, headers=HERE)
            assert again.status_code == 401 and "used already" in again.json()["detail"]


def test_a_reader_sees_no_button(browser: TestClient, engine: Engine) -> None:
    sign_in(browser)
    assert browser.post("/v1/studies", json=STUDY, headers=HERE).status_code == 201
    assert "data-path" in browser.get("/", headers=BROWSER).text
    _, secret = tokens.create(engine, name="guest", scopes=["read"], now=1.0)
    sign_in(browser, secret)
    page = browser.get("/", headers=BROWSER).text
    assert "ishigami" in page and "data-path" not in page and "New study" not in page


def test_a_sign_in_ends_with_its_time_its_token_and_by_wish(
    browser: TestClient, engine: Engine, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.http.guards.BELIEVED_SECONDS", 0.0)
    token, secret = tokens.create(engine, name="anna", scopes=["read"], now=1.0)
    sign_in(browser, secret)
    assert browser.get("/", headers=BROWSER).status_code == 200
    tokens.revoke(engine, token.id, now=2.0)
    assert browser.get("/", headers=BROWSER).status_code == 303
    sign_in(browser)
    assert browser.post("/sign-out", headers=HERE).status_code == 204
    assert browser.get("/", headers=BROWSER).status_code == 303
    sign_in(browser)
    clock.now += SIGNED_IN_SECONDS + 1.0
    browser.cookies.jar.clear_expired_cookies()
    assert browser.get("/", headers=BROWSER).status_code == 303


def test_guessing_is_slowed_down_but_looking_is_not(browser: TestClient) -> None:
    for _ in range(FAILURES + 5):
        browser.get("/", headers=BROWSER)
    sign_in(browser)
    for _ in range(FAILURES):
        assert browser.post("/sign-in", json={"token": "x"}, headers=HERE).status_code == 401
    assert browser.post("/sign-in", json={"token": "x"}, headers=HERE).status_code == 429


def test_who_has_a_good_token_gets_in_while_others_guess_from_the_same_address(
    browser: TestClient, engine: Engine
) -> None:
    _, secret = tokens.create(engine, name="anna", scopes=["read"], now=1.0)
    _, unseen = tokens.create(engine, name="berta", scopes=["read"], now=1.0)
    assert browser.get("/v1/studies", headers={"Authorization": f"Bearer {secret}"}).is_success
    for _ in range(FAILURES):
        browser.post("/sign-in", json={"token": "x"}, headers=HERE)
    for token in ("correct-horse", secret):
        sign_in(browser, token)
    assert browser.post("/sign-in", json={"token": unseen}, headers=HERE).status_code == 429


def test_a_token_that_may_not_look_is_told_so_at_the_door(
    browser: TestClient, engine: Engine
) -> None:
    _, secret = tokens.create(engine, name="node", scopes=["work", "submit"], now=1.0)
    answer = browser.post("/sign-in", json={"token": secret}, headers=HERE)
    assert answer.status_code == 403 and "set-cookie" not in answer.headers
    assert "scope read" in answer.json()["detail"]


def test_the_code_of_a_token_that_was_revoked_is_no_good(
    browser: TestClient, engine: Engine
) -> None:
    token, secret = tokens.create(engine, name="anna", scopes=["read"], now=1.0)
    bearer = {"Authorization": f"Bearer {secret}"}
    code = browser.post("/v1/sign-in-codes", headers=bearer).json()["code"]
    tokens.revoke(engine, token.id, now=2.0)
    answer = browser.post("/sign-in", json={"code": code}, headers=HERE)
    assert answer.status_code == 401 and "set-cookie" not in answer.headers


@pytest.mark.parametrize("body", [{}, {"token": None}, {"code": None}])
def test_who_sends_neither_token_nor_code_is_told_what_to_send(
    browser: TestClient, body: dict[str, None]
) -> None:
    answer = browser.post("/sign-in", json=body, headers=HERE)
    assert answer.status_code == 422 and answer.json()["detail"] == "send token or code"


@pytest.mark.parametrize("body", [{"token": ""}, {"token": "ä" * 9}, {"code": ""}])
def test_what_is_neither_token_nor_code_signs_nobody_in(
    browser: TestClient, body: dict[str, str | None]
) -> None:
    assert browser.post("/sign-in", json=body, headers=HERE).status_code == 401


def test_files_are_kept_by_the_browser_until_they_change(browser: TestClient) -> None:
    path = re.findall(r'src="(/static/[^"]+)"', browser.get("/sign-in").text)[0]
    answer = browser.get(path)
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-encoding"] == "gzip"
    plotly = path.rpartition("/")[0] + "/" + assets.PLOTLY
    assert "plotly.js" in browser.get(plotly).text[:200]
    assert browser.get(path.replace(".js", ".py")).status_code == 404
