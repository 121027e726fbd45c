"""A newcomer types what the README says, and it works."""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest

from rehyb.client import Client
from sim.models import ELBOW
from tests.testbed.fleet.warm import WarmFleet

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def test_one_assessment_prints_one_json_object_with_the_fixed_names() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "rehyb", "assess", "--set", "forearm_mass=1.2", "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    printed = json.loads(ran.stdout)
    assert printed["outcome"] == "ok"
    assert printed["wall_seconds"] > 0.0
    assert {type(printed[name]) for name in ELBOW.outputs} == {float}
    assert printed["parameters"]["forearm_mass"] == 1.2


def test_an_assessment_that_fails_has_a_reason_a_state_and_no_outputs() -> None:
    far = ("--set", "upper_arm_length=0.50", "--outside-range", "--json")
    ran = subprocess.run(
        [sys.executable, "-m", "rehyb", "assess", *far],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ran.returncode == 1
    printed = json.loads(ran.stdout)
    assert printed["outcome"] == "penetrated"
    assert printed["reason"] and printed["state"]["phase"] == "movement"
    assert not set(ELBOW.outputs) & set(printed)


def test_validation_prints_figures_beside_the_papers_and_where_the_pictures_are(
    tmp_path: Path,
) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "rehyb", "validate", "--out", str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"COLUMNS": "160"},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    for words in ("isometric flexion torque", "around 80", "around -50", "Young's modulus"):
        assert words in ran.stdout
    assert (tmp_path / "isometric_torque.png").exists()
    assert (tmp_path / "compression.png").exists()
    assert (tmp_path / "validation.html").exists()


# Last, so that no fleet works on while other tests run.
@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WarmFleet]:
    with WarmFleet(tmp_path_factory.mktemp("fleet"), workers=2) as fleet:
        yield fleet


def environment(fleet: WarmFleet) -> dict[str, str]:
    return os.environ | {"REHYB_URL": fleet.url, "REHYB_TOKEN": fleet.token}


def test_the_python_example_runs_to_its_last_line(fleet: WarmFleet) -> None:
    block = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert block is not None
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", block[1]],
        env=environment(fleet),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    lines = ran.stdout.splitlines()
    assert lines[-2].startswith("upper_arm_mass {'value':") or lines[-2].startswith("forearm_mass")
    assert any(line.endswith("of 1024") for line in lines)


def test_the_curl_lines_are_requests_the_coordinator_takes(fleet: WarmFleet) -> None:
    block = next(b for b in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) if "curl" in b)
    commands = [line for line in block.replace("\\\n", " ").splitlines() if line]
    with Client(fleet.url, fleet.token) as client:
        study = client.submit({"name": "try", "model": "ishigami", "method": "morris", "rows": 2})
        client.wait(study["id"])
    shell = {"$REHYB_TOKEN": fleet.token, "$REHYB_URL": fleet.url, "/ID/": f"/{study['id']}/"}
    for command in commands:
        for variable, value in shell.items():
            command = command.replace(variable, value)
        program, *arguments = shlex.split(command, comments=True)
        assert program == "curl"
        url = arguments.pop()
        given = dict(zip(arguments[1::2], arguments[2::2], strict=True))
        headers = dict(
            a.split(": ") for a, flag in zip(arguments[1:], arguments, strict=False) if flag == "-H"
        )
        response = httpx2.request(
            "POST" if "-d" in given else "GET", url, headers=headers, content=given.get("-d")
        )
        assert response.is_success, response.text
        if not url.endswith(".csv"):
            assert isinstance(response.json(), dict)
    with Client(fleet.url, fleet.token) as client:
        for study in client.studies():
            # Hundreds of assessments that nobody waits for.
            if study["state"] == "running":
                client.cancel(study["id"])
