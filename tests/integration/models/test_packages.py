"""A package that announces a model is found, described and evaluated; its identity is its code."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.testbed.models import laid_out

ASK = """
import json, sys
from models.evaluation import ModelFailure
from models.packages import PackagedModel, announced
model = PackagedModel(announced()["decay"])
try:
    model({"start": -1.0})
except ModelFailure as failure:
    refused = failure.outcome
print(json.dumps([model({"rate": 1.0}, 500), refused]))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay the example out as an installer does, in a folder of its own."""
    return laid_out(tmp_path_factory.mktemp("packages"))


def ran(installed: Path, *arguments: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(installed)}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_it_is_evaluated_and_its_failures_have_names(installed: Path) -> None:
    outputs, refused = json.loads(ran(installed, "-c", ASK))
    assert outputs["left"] == pytest.approx(0.36787944117)
    assert outputs["over_time[4]"] == pytest.approx(0.0183156388887)
    assert refused == "nothing_there"


def test_what_an_entry_point_lacks_is_named(tmp_path: Path) -> None:
    package = laid_out(tmp_path)
    module = package / "rehyb_example" / "__init__.py"
    module.write_text("class Decay:\n    name = 'decay'\n    factors = ()\n")
    said = subprocess.run(
        [sys.executable, "-m", "models.packages", "decay"],
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        check=False,
    ).stderr
    lacks = "it has no description, outputs, evaluate"
    assert said == f"rehyb_example:Decay is no model: {lacks}\n"


def test_its_identity_changes_with_its_files(installed: Path) -> None:
    before = json.loads(ran(installed, "-m", "models.packages", "decay"))
    assert (before["kind"], before["deterministic"]) == ("python", False)
    module = installed / "rehyb_example" / "__init__.py"
    module.write_text(module.read_text() + "# changed\n")
    after = json.loads(ran(installed, "-m", "models.packages", "decay"))
    assert after["digest"] != before["digest"]
