"""The coordinator answers whatever its own OpenAPI document allows, and what it does not."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from fastapi import FastAPI
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from pydantic import SecretStr
from schemathesis.python.asgi import shutdown_lifespans

from server.app import create_app
from server.errors import BadFileError
from server.sandbox import check
from server.settings import Settings

TOKEN = "contract"
#: Requests per route and mode; more in `make soak`.
EXAMPLES = int(os.environ.get("REHYB_CONTRACT", "15"))
HEADERS = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def apps(
    upgraded_database: Callable[[], str],
    upgraded_file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[dict[str, FastAPI]]:
    """Coordinators, by database, that have a study: some of the guesses find something.

    A process looks at a file once, however many coordinators are sent the same bytes.
    """
    said: dict[tuple[str, bytes, str], Any] = {}

    async def check_once(program: str, file: Path, **wanted: Any) -> Any:
        asked = program, file.read_bytes(), repr(wanted)
        if asked not in said:
            try:
                said[asked] = await check(program, file, **wanted)
            except BadFileError as error:
                said[asked] = error
        if isinstance(said[asked], BadFileError):
            raise said[asked]
        return said[asked]

    for noun in ("sessions", "models", "analyses"):
        monkeypatch.setattr(f"server.routes.{noun}.check", check_once)
    file = shutil.copyfile(upgraded_file, tmp_path / "rehyb.sqlite3")
    urls = {"sqlite": f"sqlite:///{file}", "postgresql": upgraded_database()}
    apps = {
        name: create_app(Settings(database_url=url, token=SecretStr(TOKEN)))
        for name, url in urls.items()
    }
    with ExitStack() as stack:
        for app in apps.values():
            client = stack.enter_context(TestClient(app, headers=HEADERS))
            study = {"name": "s", "model": "ishigami", "method": "morris", "rows": 3}
            assert client.post("/v1/studies", json=study).status_code == 201
        yield apps
        # It would keep every coordinator, and its sweeping of a database that other tests share, to
        # the end of the process.
        shutdown_lifespans()


@pytest.mark.parametrize("mode", list(schemathesis.GenerationMode), ids=lambda mode: mode.value)
def test_nothing_that_can_be_asked_makes_it_fail(
    apps: dict[str, FastAPI], mode: schemathesis.GenerationMode
) -> None:
    document = schemathesis.openapi.from_asgi(
        "/openapi.json", apps["sqlite"], headers={"Authorization": f"Bearer {TOKEN}"}
    )
    operations = list(document.get_all_operations())
    asked: dict[str, set[int]] = {name: set() for name in apps}
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
            # To think of a question takes several times as long as to answer it twice.
            for name, app in apps.items():
                response = case.call(headers=HEADERS, app=app)
                asked[name].add(response.status_code)
                assert response.status_code < 500, (name, case.as_curl_command())
                # Refused results come with a verdict for each.
                if response.status_code >= 400 and case.path != "/v1/results":
                    assert response.headers["content-type"][0] == "application/problem+json"

        # What takes no input cannot be asked wrongly.
        with suppress(Unsatisfiable):
            ask()
    assert len(operations) > 20
    expected = {200, 201, 204} if mode is schemathesis.GenerationMode.POSITIVE else {422}
    assert all(answers & expected for answers in asked.values())
