"""As a new user: models of each kind become studies on a fleet, and their indices are right."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import log
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rehyb.cli import app
from rehyb.client import Client
from tests.testbed.fleet.warm import WarmFleet
from tests.testbed.models import EXAMPLES, edited, laid_out
from tests.testbed.sessions.synthetic import write_session

ROWS = 128


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WarmFleet]:
    """A coordinator with its analysis, and no worker."""
    with WarmFleet(tmp_path_factory.mktemp("fleet"), workers=0) as fleet:
        yield fleet


@pytest.fixture(scope="module")
def environment(
    fleet: WarmFleet, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, str]]:
    """What a terminal has in which the fleet's address was pasted, and a package installed."""
    packages = str(laid_out(tmp_path_factory.mktemp("packages")))
    with pytest.MonkeyPatch.context() as here:
        here.syspath_prepend(packages)
        yield os.environ | {
            "REHYB_URL": fleet.url,
            "REHYB_TOKEN": fleet.token,
            "PYTHONPATH": packages,
            "XDG_STATE_HOME": str(tmp_path_factory.mktemp("state")),
        }


@pytest.fixture(scope="module")
def server(environment: dict[str, str]) -> Iterator[str]:
    """The Ishigami function as an UM-Bridge server."""
    with serving(environment) as url:
        yield url


@contextmanager
def serving(environment: dict[str, str], port: str = "0") -> Iterator[str]:
    """Serve the Ishigami function by UM-Bridge; yields the server's URL."""
    arguments = ["umbridge", "serve", "--model", "ishigami", "--port", port, "--processes", "1"]
    with started(environment, "rehyb", *arguments) as process:
        assert process.stdout is not None
        found = re.match(r"(http://\S+) serves ishigami", process.stdout.readline())
        assert found is not None
        yield found[1]
        process.terminate()


def edited_for_a_server(name: str, scratch: Path) -> Path:
    """Return the folder of a model of a server, the Ishigami function by another name."""
    remote = {
        "ishigami_python": name,
        'kind = "command"': 'kind = "umbridge"',
        "[command]": "[umbridge]",
        'run = ["python3", "ishigami.py"]\nkeep = true': 'name = "ishigami"',
    }
    return edited("ishigami_python", scratch, remote)


@pytest.fixture(scope="module")
def worker(
    environment: dict[str, str], server: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[list[str]]:
    """A worker that has the examples; yields the options that say where they are."""
    folder = tmp_path_factory.mktemp("models")
    for example in ("ishigami_awk", "ishigami_python", "noisy_pendulum"):
        shutil.copytree(EXAMPLES / example, folder / example)
    (folder / "remote").mkdir()
    shutil.move(edited_for_a_server("remote", folder / "remote"), folder / "elsewhere")
    options = ["--models", str(folder), "--allow", "decay", "--umbridge", server]
    with started(environment, "rehyb-worker", "--processes", "1", *options) as process:
        announced(environment, "decay", process)
        yield options
        process.terminate()


def started(environment: dict[str, str], command: str, *arguments: str) -> "subprocess.Popen[str]":
    program = [str(Path(sys.executable).with_name(command)), *arguments]
    said: Any = subprocess.PIPE if command == "rehyb" else subprocess.DEVNULL
    return subprocess.Popen(program, env=environment, stdout=said, stderr=said, text=True)


def announced(environment: dict[str, str], model: str, worker: "subprocess.Popen[str]") -> None:
    """Wait until a worker has announced a model: a study of it is refused before."""
    with Client(environment["REHYB_URL"], environment["REHYB_TOKEN"]) as client:
        deadline = time.monotonic() + 120.0
        while model not in {model["name"] for model in client.models()}:
            assert worker.poll() is None and time.monotonic() < deadline
            time.sleep(0.1)


def ran(environment: dict[str, str], *arguments: str) -> str:
    """Return what the command prints, which does here what it does in a process of its own."""
    result = CliRunner().invoke(app, arguments, env=environment, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture
def client(fleet: WarmFleet) -> Iterator[Client]:
    with Client(fleet.url, fleet.token) as client:
        yield client


def finished(client: Client, **study: Any) -> dict[str, Any]:
    """Submit a study and return its indices when it is complete."""
    asked = {"name": study["model"], "method": "saltelli", "rows": ROWS, "seed": 3, **study}
    return awaited(client, client.submit(asked)["id"], asked["rows"])


def awaited(client: Client, study: str, rows: int) -> dict[str, Any]:
    """Return a study's indices when it is complete."""
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        if client.study(study)["state"] == "complete":
            snapshot = client.indices(study)
            if snapshot["rows_used"] == rows:
                return snapshot
        time.sleep(0.2)
    raise AssertionError(f"not complete: {client.progress(study)}")


def of(snapshot: dict[str, Any], output: str, factor: str) -> dict[str, Any]:
    found: dict[str, Any] = snapshot["outputs"][output]["factors"][factor]
    return found


@pytest.mark.usefixtures("worker")
def test_an_xml_file_becomes_indices_that_agree_with_its_closed_form(
    environment: dict[str, str], client: Client
) -> None:
    folder = str(EXAMPLES / "pendulum")
    assert "nominal" in ran(environment, "model", "check", folder)
    assert "every worker evaluates it" in ran(environment, "model", "add", folder)
    fixed = {"mass": 1.0}
    snapshot = finished(client, model="pendulum", fixed=fixed, outputs=["rest_angle"])
    # rest_angle = gain * 0.5 / stiffness, both uniform.
    mean = 0.5 * log(20.0 / 5.0) / 15.0
    variance, of_gain = 0.25 / (5.0 * 20.0) - mean**2, 0.4**2 / 12.0
    total = variance + of_gain * mean**2 + of_gain * variance
    for factor, first, whole in (
        ("stiffness", variance / total, (variance + of_gain * variance) / total),
        ("motor_gain", of_gain * mean**2 / total, of_gain * (mean**2 + variance) / total),
    ):
        found = of(snapshot, "rest_angle", factor)
        for index, truth in (("first_order", first), ("total_order", whole)):
            # One 90 % interval in ten misses; twice as wide, one in a thousand.
            width = found[index]["high"] - found[index]["low"]
            assert found[index]["low"] - width / 2 <= truth <= found[index]["high"] + width / 2


@pytest.mark.usefixtures("worker")
def test_a_program_in_two_languages_a_server_and_our_own_give_the_same_indices(
    client: Client,
) -> None:
    models = ("ishigami", "ishigami_python", "ishigami_awk", "remote")
    found = {
        model: of(finished(client, model=model, rows=16), "y", "x1")["total_order"]["value"]
        for model in models
    }
    assert found == dict.fromkeys(models, pytest.approx(found["ishigami"], rel=1e-9))


def test_a_server_that_is_away_costs_no_instance_and_its_study_goes_on_when_it_is_back(
    environment: dict[str, str], client: Client, tmp_path: Path
) -> None:
    """A newcomer's study was over within a second, all of its instances crashed."""
    folder = str(edited_for_a_server("far", tmp_path))
    with serving(environment) as url:
        options = ["--models", folder, "--umbridge", url, "--processes", "2"]
        process = started(environment, "rehyb-worker", *options)
        announced(environment, "far", process)
    try:
        asked = {"name": "far", "model": "far", "method": "saltelli", "rows": 16, "seed": 1}
        study = client.submit(asked)["id"]
        deadline = time.monotonic() + 60.0
        while "Connection refused" not in str(client.progress(study)["why_it_waits"]):
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.1)
        assert client.progress(study)["failures"] == {}
        with serving(environment, port=url.rpartition(":")[2]):
            awaited(client, study, 16)
        assert client.progress(study)["failures"] == {}
    finally:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("worker")
def test_a_package_is_a_model_where_its_owner_allowed_it(client: Client) -> None:
    snapshot = finished(client, model="decay", rows=16)
    assert (set(snapshot["outputs"]), set(snapshot["curves"])) == ({"left"}, {"over_time"})
    assert of(snapshot, "left", "start")["total_order"]["value"] > 0.0


def test_any_instance_and_any_bundle_is_computed_again(
    environment: dict[str, str], client: Client, worker: list[str], tmp_path: Path
) -> None:
    models = ("pendulum", "ishigami_python", "decay", "remote", "noisy_pendulum")
    ran(environment, "model", "add", str(EXAMPLES / "pendulum"))
    for model in models:
        study = finished(client, model=model, rows=4)["study"]
        where = [] if model == "pendulum" else worker
        said = ran(environment, "study", "instance", study, "2", "1", "--replay", *where)
        assert "bit for bit" in said, said
        if model not in ("pendulum", "decay"):
            continue
        bundle = str(tmp_path / f"{model}.zip")
        ran(environment, "bundle", study, "--out", bundle)
        said = ran(environment, "reproduce", bundle, "--check", "--sample", "3", *where)
        assert "3 of" in said and "come out bit for bit" in said, said
        if model == "decay":
            # What is code runs here only where it is named.
            with started(environment, "rehyb", "reproduce", bundle, "--check") as process:
                said = process.communicate(timeout=120)[0]
            assert process.returncode == 1
            assert "name it with --allow NAME" in said


@pytest.mark.usefixtures("worker")
def test_a_model_with_noise_of_its_own_tells_its_share(
    environment: dict[str, str], client: Client
) -> None:
    study = finished(client, model="noisy_pendulum")
    # As tests/unit/server/logic/study/test_own_noise.py has it: 0.01^2 of 4.98e-4.
    found = of(study, "rest_angle", "seed")["total_order"]
    width = found["high"] - found["low"]
    assert found["low"] - width / 2 <= 0.2008 <= found["high"] + width / 2
    assert "own noise is" in ran(environment, "study", "indices", study["study"])


@pytest.mark.usefixtures("worker")
def test_what_closing_a_loop_found_is_a_study_in_one_command(
    environment: dict[str, str], client: Client, tmp_path: Path
) -> None:
    session, found = str(tmp_path / "my robot"), str(tmp_path / "found")
    short: dict[str, Any] = {"speeds": (0.8, 1.6), "postures": (-1.2, 0.1), "rate": 250.0}
    write_session(Path(session), 3, ("coulomb_friction",), **short)
    ran(environment, "close-loop", session, "--out", found)
    options = ["--rows", "16", "--method", "saltelli"]
    study = ran(environment, "study", "of-session", session, found, *options).split()[0]
    snapshot = awaited(client, study, 16)
    ranked = snapshot["outputs"]["elbow.torque_rms"]["factors"]
    assert {"elbow.coulomb_friction.torque", "elbow.impedance.stiffness"} <= set(ranked)
    assert client.study(study)["model"].startswith("my_robot@")
    assert client.progress(study)["failures"] == {}
