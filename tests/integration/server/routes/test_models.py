"""Models come to a coordinator by upload or by announcement, and studies keep their version."""

import csv
import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from analysis.sensitivity.service import catch_up
from models.description import Description
from models.folder import pack, read_folder
from server.app import create_app
from server.clocks import Forward
from server.operations import models, tokens
from server.operations.study.result_log import StoreResultLog
from server.settings import Settings
from server.store.database.engine import writing
from sim.models import MODELS
from tests.testbed.clock import Clock
from tests.testbed.coordinators.rest_bodies import is_problem
from tests.testbed.models import EXAMPLES, edited

TOKEN = "models"


@pytest.fixture
def app(upgraded_sqlite: str) -> FastAPI:
    return create_app(Settings(database_url=upgraded_sqlite, token=SecretStr(TOKEN)))


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, headers={"Authorization": f"Bearer {TOKEN}"}) as client:
        yield client


def uploaded(client: TestClient, content: bytes) -> Any:
    headers = {"Content-Type": "application/zip"}
    return client.post("/v1/models", content=content, headers=headers)


def packed(folder: Path) -> bytes:
    file = folder.with_suffix(".zip")
    pack(read_folder(folder), file)
    return file.read_bytes()


def announced(name: str = "elsewhere", **changes: Any) -> dict[str, Any]:
    return {
        "name": name,
        "kind": "command",
        "code": "1",
        "factors": [{"name": "x", "unit": "1", "low": 0.0, "high": 1.0, "nominal": 0.5}],
        "outputs": [{"name": "y", "unit": "1"}],
        **changes,
    }


def submitted(client: TestClient, model: str) -> dict[str, Any]:
    body = {"name": "a", "model": model, "method": "morris", "rows": 2}
    answer = client.post("/v1/studies", json=body)
    assert answer.status_code == 201, answer.text
    study: dict[str, Any] = answer.json()
    return study


def lease(client: TestClient, *models: str) -> int:
    worker = {"id": "w", "host": "h", "versions": {}}
    asked = {"worker": worker, "models": list(models), "max_instances": 1}
    return int(client.post("/v1/leases", json=asked).status_code)


def test_those_of_rehyb_are_there_from_the_start(client: TestClient) -> None:
    models = {model["name"]: model for model in client.get("/v1/models").json()["models"]}
    assert models.keys() == MODELS.keys()
    assert models["ishigami"]["own"]
    assert len(models["elbow"]["factors"]) == len(MODELS["elbow"].factors)


def test_those_of_rehyb_are_announced_again_at_every_start_by_one_statement(
    engine: Engine,
) -> None:
    asked: list[str] = []
    sa.event.listen(engine, "before_cursor_execute", lambda *event: asked.append(event[2]))
    for now in (5.0, 9.0):
        models.register_built_in(engine, MODELS.values(), now=now)
    assert sum("models" in statement for statement in asked) == 2
    assert {model.name: model.announced_at for model in models.every(engine)} == dict.fromkeys(
        MODELS, 9.0
    )


def test_an_upload_can_be_had_back_and_sampled_by_its_version(
    client: TestClient, tmp_path: Path
) -> None:
    content = packed(edited("pendulum", tmp_path))
    answer = uploaded(client, content)
    assert answer.status_code == 201, answer.text
    version = f"pendulum@{answer.json()['digest']}"
    assert uploaded(client, content).status_code == 200
    assert client.get(f"/v1/models/{version}/archive").content == content
    study = submitted(client, "pendulum")
    assert study["model"] == version
    assert study["units"]["rest_angle"] == "rad"
    assert lease(client, "pendulum", "ishigami") == 204
    wanted = client.get("/v1/models?wanted=true").json()["models"]
    assert [f"{model['name']}@{model['digest']}" for model in wanted] == [version]
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["waits_for"] == version
    assert lease(client, version) == 201
    assert client.get(f"/v1/studies/{study['id']}/progress").json()["waits_for"] is None


def test_a_busy_worker_and_one_that_closes_loops_are_not_taken_for_absent(
    app: FastAPI, client: TestClient
) -> None:
    clock = Clock()
    app.state.clock = Forward(clock)
    model = client.post("/v1/models", json=announced()).json()
    version = f"elsewhere@{model['digest']}"
    first, second = submitted(client, "elsewhere"), submitted(client, "elsewhere")

    def waits_for() -> Any:
        return client.get(f"/v1/studies/{second['id']}/progress").json()["waits_for"]

    assert waits_for() == version
    assert lease(client, version) == 201
    asked = {"worker": {"id": "w", "host": "h", "versions": {}}}
    assert client.post("/v1/close-loops/lease", json=asked).status_code == 204
    assert waits_for() is None
    # Its lease lasts for longer than a silent worker is believed to be there.
    clock.advance(70.0)
    with writing(app.state.engine) as connection:
        connection.exec_driver_sql(f"UPDATE leases SET expires_at = {app.state.clock() + 30.0}")
    assert waits_for() is None
    clock.advance(70.0)
    assert waits_for() == version
    assert first["model"] == version


def test_a_study_says_why_a_worker_refuses_its_model(client: TestClient) -> None:
    model = client.post("/v1/models", json=announced()).json()
    version = f"elsewhere@{model['digest']}"
    study = submitted(client, version)
    path = f"/v1/studies/{study['id']}/progress"
    assert client.get(path).json()["why_it_waits"] is None

    def asks(refused: dict[str, str], models: list[str]) -> int:
        who = {"id": "w", "host": "pc7", "refused": refused}
        asked = {"worker": who, "models": models, "max_instances": 1}
        return client.post("/v1/leases", json=asked).status_code

    assert asks({version: "it gives other numbers"}, ["ishigami"]) == 204
    told = client.get(path).json()
    assert told["waits_for"] == version
    assert told["why_it_waits"] == "pc7 refuses it: it gives other numbers"
    assert client.get("/v1/workers").json()["workers"][0]["refused"] == {
        version: "it gives other numbers"
    }
    # What it says of a model changes nothing of who may have its study.
    assert asks({version: "it gives other numbers"}, [version]) == 201
    assert asks({version: "two\nlines"}, ["ishigami"]) == 422
    assert asks({}, ["ishigami"]) == 204
    assert client.get("/v1/workers").json()["workers"][0]["refused"] == {}


def test_a_model_whose_code_a_group_lacks_is_no_work_for_it_but_one_that_it_brings_is(
    client: TestClient,
) -> None:
    def told(group: str) -> Any:
        found = client.get(f"/v1/work?group={group}").json()
        return found["waiting"], found["unfit"], found["why"]

    headers = {"X-Rehyb-Worker": "night@1"}
    model = client.post("/v1/models", json=announced(), headers=headers).json()
    version = f"elsewhere@{model['digest']}"
    study = submitted(client, version)
    count = study["instances"]
    for group in ("day", "night"):
        who = {"id": f"{group}@1", "host": "pc7"}
        asked = {"worker": who, "models": ["ishigami"], "max_instances": 1}
        assert client.post("/v1/leases", json=asked).status_code == 204
    why = (
        f"study {study['id']} samples {version}, whose code none of these workers has "
        "(rehyb-worker --models or --allow)"
    )
    assert told("day") == (0, count, why)
    # It has yet to try the model that it brought: until then it does not ask for its work.
    assert told("night") == (count, 0, "")


def test_a_row_stays_with_machines_that_compute_the_same_of_this_model(client: TestClient) -> None:
    model = client.post("/v1/models", json=announced()).json()
    version = f"elsewhere@{model['digest']}"
    body = {"name": "a", "model": version, "method": "morris", "rows": 1}
    study = client.post("/v1/studies", json=body).json()

    def instances(worker: str, canary: str, count: int) -> int:
        who = {"id": worker, "host": worker, "versions": {}, "canaries": {version: canary}}
        asked = {"worker": who, "models": [version], "max_instances": count}
        answer = client.post("/v1/leases", json=asked)
        return len(answer.json()["instances"]) if answer.status_code == 201 else 0

    assert study["instances"] == 2
    assert instances("a", "c0ffee", 1) == 1
    assert instances("b", "decaf", 1) == 0
    assert instances("c", "c0ffee", 1) == 1


def test_a_study_means_the_newest_version_unless_it_says_which(client: TestClient) -> None:
    by = {"X-Rehyb-Worker": "pc7-4711"}
    first = client.post("/v1/models", json=announced(), headers=by).json()
    assert first["announced_by"] == "pc7-4711"
    second = client.post("/v1/models", json=announced(code="2")).json()
    assert first["digest"] != second["digest"]
    assert submitted(client, "elsewhere")["model"] == f"elsewhere@{second['digest']}"
    older = f"elsewhere@{first['digest']}"
    assert submitted(client, older)["model"] == older
    assert lease(client, older) == 201
    assert client.get(f"/v1/models/{older}/archive").status_code == 404


def test_a_description_is_read_as_any_other_body(client: TestClient) -> None:
    headers = {"Content-Type": "application/json"}
    marked = b"\xef\xbb\xbf" + json.dumps(announced()).encode()
    assert client.post("/v1/models", content=marked, headers=headers).status_code == 201
    for body in (b"null", b"[]", b'{"name": '):
        answers = [
            client.post(route, content=body, headers=headers)
            for route in ("/v1/models", "/v1/leases")
        ]
        assert is_problem(answers[0], 422) == is_problem(answers[1], 422)


def test_a_name_of_rehyb_and_a_model_that_is_not_there_are_refused(
    client: TestClient, tmp_path: Path
) -> None:
    answer = client.post("/v1/models", json=announced("ishigami"))
    assert answer.status_code == 409
    assert "choose another name" in answer.json()["detail"]
    folder = edited("pendulum", tmp_path, {'name = "pendulum"': 'name = "elbow"'})
    assert uploaded(client, packed(folder)).status_code == 409
    assert client.get("/v1/models/knee").status_code == 404
    body = {"name": "a", "model": "knee", "method": "morris", "rows": 2}
    answer = client.post("/v1/studies", json=body)
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/model")
    assert "expected one of" in answer.json()["detail"]
    assert answer.json()["detail"].endswith("is added first (rehyb model add DIR)")


def test_a_model_that_a_worker_has_does_not_take_the_name_of_an_uploaded_one(
    client: TestClient, app: FastAPI, tmp_path: Path
) -> None:
    """Later studies of `pendulum` meant the worker's program."""
    version = uploaded(client, packed(edited("pendulum", tmp_path))).json()
    secret = tokens.create(app.state.engine, name="w", scopes=["work"], now=1.0)[1]
    headers = {"Authorization": f"Bearer {secret}"}
    refused = client.post("/v1/models", json=announced("pendulum"), headers=headers)
    assert refused.status_code == 409
    assert refused.json()["detail"] == (
        "pendulum is a model of kind mjcf that somebody uploaded: give this one of kind command "
        "another name"
    )
    assert submitted(client, "pendulum")["model"] == f"pendulum@{version['digest']}"
    assert client.post("/v1/models", json=announced(), headers=headers).status_code == 201


def test_names_that_clash_with_columns_of_results_are_refused_unless_they_were_kept(
    client: TestClient, app: FastAPI
) -> None:
    outputs = [{"name": "row", "unit": "1"}]
    answer = client.post("/v1/models", json=announced(outputs=outputs))
    assert answer.status_code == 422
    assert "outputs[0].name: row is what a column" in answer.json()["detail"]
    kept = Description.from_json(announced(outputs=outputs), kept=True)
    models.announce(app.state.engine, kept, by="w", now=1.0)
    assert client.get("/v1/models/elsewhere").json()["outputs"][0]["name"] == "row"
    assert kept.digest in str(client.get("/v1/models").json())
    body = {"name": "a", "model": "elsewhere", "method": "morris", "rows": 2}
    answer = client.post("/v1/studies", json=body)
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/model")


def test_a_token_for_work_may_announce_and_fetch_and_one_for_reading_may_not(
    client: TestClient, app: FastAPI
) -> None:
    for scope, expected in (("work", 201), ("read", 403)):
        secret = tokens.create(app.state.engine, name="n", scopes=[scope], now=1.0)[1]
        headers = {"Authorization": f"Bearer {secret}"}
        assert client.post("/v1/models", json=announced(), headers=headers).status_code == expected
        assert client.get("/v1/models?wanted=true", headers=headers).status_code == 200


def bomb() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("model.toml", (EXAMPLES / "pendulum" / "model.toml").read_text())
        archive.writestr("mesh.stl", bytes(30_000_000))
    return file.getvalue()


def escaping() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("../model.toml", "")
    return file.getvalue()


HOSTILE = {
    "no zip": (lambda _: b"PK", "neither a folder nor a zip"),
    "a path out of it": (lambda _: escaping(), "no path inside"),
    "a bomb": (lambda _: bomb(), "more than a model takes"),
    "an include": ({"<worldbody>": '<include file="x.xml"/><worldbody>'}, "<include> is"),
    "a plugin": ({"<worldbody>": "<extension/><worldbody>"}, "is a plugin, which is code"),
    "a factor that leads nowhere": ({"joint.hinge.": "joint.knee."}, "there is no joint 'knee'"),
    "a range of NaN": ({"low = 5.0": "low = nan"}, "must be finite"),
    "a program": ({'kind = "mjcf"': 'kind = "command"'}, "[mjcf] is unknown"),
    "a nominal value out of its range": ({"nominal = 10.0": "nominal = 30.0"}, "outside its range"),
    "a picture of a billion pixels": (
        {
            "<worldbody>": '<asset><texture builtin="flat" width="40000" height="40000"/></asset>'
            "<worldbody>"
        },
        "<texture> has 1.6e+09 cells",
    ),
    "memory without end": ({"<worldbody>": '<size memory="1T"/><worldbody>'}, "<size> has memory"),
    "an endless simulation": ({"duration = 2.0": "duration = 1e12"}, "at most"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_upload_is_one_sentence_and_leaves_nothing(
    client: TestClient, tmp_path: Path, what: str
) -> None:
    spoilt, words = HOSTILE[what]
    if callable(spoilt):
        content = spoilt(None)
    else:
        folder = edited("pendulum", tmp_path, spoilt)
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as archive:
            for path in folder.iterdir():
                archive.write(path, path.name)
        content = file.getvalue()
    answer = uploaded(client, content)
    assert answer.status_code == 422, answer.text
    assert words in answer.json()["detail"]
    assert client.get("/v1/models/pendulum").status_code == 404


def test_ten_thousand_factors_are_refused(client: TestClient) -> None:
    factor = announced()["factors"][0]
    factors = [{**factor, "name": f"x{i}"} for i in range(10_000)]
    answer = client.post("/v1/models", json=announced(factors=factors))
    assert (answer.status_code, "at most 1000" in answer.json()["detail"]) == (422, True)
    assert client.post("/v1/models", content=b"{", headers={"Content-Type": "application/json"})


def test_a_description_of_any_type_that_is_json_is_no_zip_file(client: TestClient) -> None:
    for kind in ("application/vnd.x+json", "Application/JSON"):
        answer = client.post("/v1/models", content=b"{}", headers={"Content-Type": kind})
        assert answer.json()["detail"] == "model.name: is missing"


def test_a_curve_is_asked_for_sent_stored_and_read_as_one(client: TestClient, app: FastAPI) -> None:
    wave = {"name": "wave", "unit": "Nm", "curve": 3, "over": "time", "over_unit": "s", "high": 2.0}
    model = announced(outputs=[{"name": "y", "unit": "1"}, wave])
    version = f"elsewhere@{client.post('/v1/models', json=model).json()['digest']}"
    study = submitted(client, version)
    assert study["outputs"] == ["y", "wave"] and study["units"]["wave"] == "Nm"
    axis = {"points": 3, "over": "time", "unit": "s", "low": 0.0, "high": 2.0}
    assert study["curves"] == {"wave": axis}
    worker = {"id": "w", "host": "h", "versions": {}}
    asked = {"worker": worker, "models": [version], "max_instances": 4}
    lease = client.post("/v1/leases", json=asked).json()
    assert lease["instances"][0]["curves"] == {"wave": axis}
    sent = [[0.1, 1e-300, -3.5], [0.2, 0.25, 1 / 3], [1.0, 2.0], [1.0, 2.0, 3.0]]
    answer = client.post(
        "/v1/results",
        json={
            "lease": lease["id"],
            "fence": lease["fence"],
            "worker": "w",
            "results": [
                {"instance": one["id"], "outcome": "ok", "outputs": {"y": 1.0, "wave": curve}}
                for one, curve in zip(lease["instances"], sent, strict=True)
            ],
        },
    )
    assert answer.json()["verdicts"][2] == {
        "instance": lease["instances"][2]["id"],
        "verdict": "invalid",
        "detail": "output wave must have 3 points, not 2",
    }
    with app.state.engine.connect() as connection:
        query = sa.text("select outputs from results order by row, position")
        stored = json.loads(connection.scalars(query).first())
    assert isinstance(stored["wave"], str)
    lines = list(csv.DictReader(client.get(f"/v1/studies/{study['id']}/results.csv").text.split()))
    assert [[float(line[f"wave[{i}]"]) for i in range(3)] for line in lines] == sent[:2] + sent[3:]
    catch_up(StoreResultLog(app.state.engine), study["id"])
    indices = client.get(f"/v1/studies/{study['id']}/indices").json()
    assert indices["curves"]["wave"]["axis"] == [0.0, 1.0, 2.0]
    assert list(indices["outputs"]) == ["y"]
