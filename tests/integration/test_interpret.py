"""From a bank to K_h with an interval, by the commands that a clinic types."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rehyb.cli import app

RUNNER = CliRunner()


def run(*arguments: str) -> Any:
    result = RUNNER.invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bank") / "bank.npz"
    small = ("--contact-rows", "0", "--processes", "1", "--out", str(path))
    first = run("bank", "build", "--rows", "170", *small)
    more = run("bank", "build", "--rows", "180", "--extend", *small)
    failed = sum(more["bushing"]["failed"].values())
    assert more["bushing"]["recordings"] + failed == 180
    assert more["id"] != first["id"]
    assert run("bank", "show", "--bank", str(path))["id"] == more["id"]
    return path


def test_a_recording_is_interpreted_and_reported(bank: Path, tmp_path: Path) -> None:
    recorded = str(tmp_path / "a.npz")
    patient = (
        "activation=0.05",
        "muscles=physiological",
        "passive_stiffness=3",
        "seat_angle=-0.05",
    )
    settings = [part for one in patient for part in ("--set", one)]
    truth = run("assess", "--fidelity", "bushing", *settings, "--record", recorded)
    page = tmp_path / "a.html"
    asked = ("interpret", recorded, "--bank", str(bank))
    found = run(
        *asked, "--known", "forearm_mass=0.962:0.1", "--tolerance", "0.3", "--out", str(page)
    )
    low, high = found["stiffness"]["interval90"]
    # 180 rows say little, but they say where it is.
    assert low - 1.0 < -truth["stiffness_sum"] < high + 1.0
    assert found["known"] == [{"name": "forearm_mass", "value": 0.962, "sd": 0.1}]
    assert {"damping", "stiffness_over_angle", "parts", "next", "bank"} <= set(found)
    assert page.read_text().startswith("<!DOCTYPE html>")
    lines = RUNNER.invoke(app, list(asked)).stdout
    assert "90 %:" in lines


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        ("forearm_mass=0.9", "name=value:sd"),
        ("forearm_mass", "name=value"),
        ("forearm_mass=heavy:1", "must be a number"),
    ],
)
def test_a_known_value_without_its_accuracy_is_one_sentence(known: str, sentence: str) -> None:
    result = RUNNER.invoke(app, ["interpret", "a.npz", "--known", known])
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())
