"""Tables over HTTP: what is told of them, and what is refused."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from pydantic import SecretStr

from server.app import create_app
from server.settings import Settings
from tests.testbed.command import Run
from tests.testbed.command import run as run
from tests.testbed.coordinators.rest_bodies import STUDY, is_problem


@pytest.fixture(scope="module")
def client(upgraded_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    file = shutil.copyfile(upgraded_file, tmp_path_factory.mktemp("given") / "rehyb.sqlite3")
    app = create_app(Settings(database_url=f"sqlite:///{file}", token=SecretStr("t")))
    with TestClient(app, headers={"Authorization": "Bearer t"}) as client:
        yield client


@pytest.fixture(scope="module")
def table() -> bytes:
    x = np.random.default_rng(1).random((70, 2))
    lines = [f"{a},{b},{a + b * b}" for a, b in x.tolist()]
    return "\n".join(["a,b,y", *lines]).encode()


def test_a_coordinator_answers_what_the_command_line_does(
    client: TestClient, table: bytes, tmp_path: Path, run: Run
) -> None:
    told = client.post("/v1/analyses", params={"output": "y", "name": "r.csv"}, content=table)
    assert told.status_code == 200
    (tmp_path / "r.csv").write_bytes(table)
    status, said, _ = run("analyse", str(tmp_path / "r.csv"), "--output", "y", "--json")
    assert status == 0 and json.loads(said) == told.json()
    status, said, _ = run("analyse", str(tmp_path / "r.csv"), "--output", "y")
    assert "R²-HSIC" in said and "p = " in said and "assumes" in said
    status, said, complained = run("analyse", str(tmp_path / "r.csv"))
    assert (status, said) == (2, "")
    assert complained == "rehyb: r.csv: say which column is the output: it has a, b, y\n"


def test_what_cannot_be_analysed_is_refused_with_line_and_column(client: TestClient) -> None:
    wrong = b"a,b,y\n" + b"1,2,3\n" * 40 + b"1,two,3\n" + b"1,2,3\n" * 40
    problem = is_problem(client.post("/v1/analyses", params={"output": "y"}, content=wrong), 422)
    assert problem["detail"].startswith("table: line 42 of column b reads 'two'")
    assert (problem["column"], problem["line"]) == ("b", 42)
    assert (
        is_problem(client.post("/v1/analyses", content=b""), 422)["detail"] == "table: it is empty"
    )


def test_a_column_whose_name_goes_on_in_the_next_line_may_be_asked_for(
    client: TestClient, table: bytes
) -> None:
    file = table.replace(b"a,b,y", b'a,b,"y\n[Nm]"')
    told = client.post("/v1/analyses", params={"output": "y\n[Nm]"}, content=file)
    assert told.status_code == 200 and list(told.json()["outputs"]) == ["y [Nm]"]


def test_a_study_without_results_says_so(client: TestClient) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    problem = is_problem(client.post(f"/v1/studies/{study}/analyses"), 422)
    assert "it has 0 rows, and not the 64 or more" in problem["detail"]
    is_problem(client.post("/v1/studies/none/analyses"), 404)
