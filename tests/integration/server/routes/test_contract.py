"""The coordinator answers whatever its own OpenAPI document allows, and what it does not."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import schemathesis
from fastapi import FastAPI
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from pydantic import SecretStr

from server.app import create_app
from server.settings import Settings
from server.store import upgrade

TOKEN = "contract"
#: Requests per route and mode.
EXAMPLES = 15
HEADERS = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture(params=["sqlite", "postgresql"])
def app(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[FastAPI]:
    """A coordinator that has a study, so that some of the guesses find something."""
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path / 'rehyb.sqlite3'}"
    else:
        url = request.getfixturevalue("empty_database")()
    upgrade(url)
    app = create_app(Settings(database_url=url, token=SecretStr(TOKEN)))
    with TestClient(app, headers=HEADERS) as client:
        study = {"name": "s", "model": "ishigami", "method": "morris", "rows": 3}
        assert client.post("/v1/studies", json=study).status_code == 201
        yield app


@pytest.mark.parametrize("mode", list(schemathesis.GenerationMode), ids=lambda mode: mode.value)
def test_nothing_that_can_be_asked_makes_it_fail(
    app: FastAPI, mode: schemathesis.GenerationMode
) -> None:
    operations = list(schemathesis.openapi.from_asgi("/openapi.json", app).get_all_operations())
    asked: set[int] = set()
    for found in operations:
        operation = found.ok()
        if operation.path.endswith("/events"):
            # A stream has an end only if the study has one.
            continue

        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            derandomize=True,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy(generation_mode=mode))
        def ask(case: schemathesis.Case) -> None:
            response = case.call(headers=HEADERS)
            asked.add(response.status_code)
            assert response.status_code < 500, case.as_curl_command()
            # Refused results come with a verdict for each.
            if response.status_code >= 400 and case.path != "/v1/results":
                assert response.headers["content-type"][0] == "application/problem+json"

        # What takes no input cannot be asked wrongly.
        with suppress(Unsatisfiable):
            ask()
    assert len(operations) > 20
    assert asked & ({200, 201, 204} if mode is schemathesis.GenerationMode.POSITIVE else {422})
