"""The full simulation as a patient, analysed blind; and the loop closed to a new ranking."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.identification.interface import REMARK
from analysis.closeloop.loop import analyse
from rehyb.client import Client
from sim.assessment.assess import assess
from tests.testbed.fleet.warm import WarmFleet
from tests.testbed.sessions.closed import closed_without_page
from tests.testbed.sessions.patient import (
    EXERCISES,
    Exercise,
    record_exercise,
    true_impedance,
    write_session,
)

#: The authors' own arm, 4.2 mm off the robot's axis. On it, friction is named; where the axes
#: coincide, what soft tissue leaves makes of it a friction that depends on load.
RELAXED = {"activation": 0.05, "elbow_offset": -0.0042}
FRICTION = {"effect.coulomb_friction.torque": 2.8}
#: Enough for one speed to predict the others.
SHORT = (EXERCISES[0], EXERCISES[2], EXERCISES[4])


def recorded(folder: Path, values: dict[str, float]) -> float:
    """Record a session of a relaxed arm; return its true damping."""
    records = [record_exercise(RELAXED | values, exercise, "bushing") for exercise in SHORT]
    write_session(folder, SHORT, records, np.random.default_rng(1))
    return true_impedance(records)[1]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float, dict[str, Any]]:
    """A robot whose elbow rubs: folder, true damping and report."""
    folder = tmp_path_factory.mktemp("rubbing")
    damping = recorded(folder / "session", FRICTION)
    return folder, damping, closed_without_page(folder / "session", folder / "out")


def test_friction_of_the_robot_is_found_through_soft_tissue_and_muscles(
    rubbing: tuple[Path, float, dict[str, Any]],
) -> None:
    _, truth, report = rubbing
    assert report["verdict"] == "effect_found"
    assert [effect["name"] for effect in report["effects"]] == ["coulomb_friction"]
    found = report["effects"][0]["parameters"]["torque"]["value"]
    assert found == pytest.approx(2.8, rel=0.1)
    # Friction stood in the damping; stiffness keeps what misalignment does to every such arm.
    damping = report["impedance"]["J4"]["damping"]
    assert abs(damping["after"] - truth) < 0.3 * abs(damping["before"] - truth)
    error = report["error"]["holdout"]["J4"]
    assert error["after"] < 0.6 * error["before"]


def test_soft_tissue_and_a_misaligned_arm_are_not_blamed_on_friction(tmp_path: Path) -> None:
    recorded(tmp_path, {"upper_arm_length": 0.3537})
    report = analyse(tmp_path).report
    assert report["verdict"] == "unexplained"
    assert report["effects"] == []
    assert REMARK in report["warnings"]
    assert report["unexplained"]["J4"]["rms"] > 0.1


def test_the_papers_single_sigmoid_is_not_enough_and_the_next_trial_is_named(
    tmp_path: Path,
) -> None:
    record = assess(RELAXED | FRICTION, fidelity="bushing").record
    assert record is not None
    sigmoid = Exercise(name="sigmoid", rate=2.0, amplitude=1.745, cycles=1)
    write_session(tmp_path, (sigmoid,), [record], np.random.default_rng(1))
    report = analyse(tmp_path).report
    assert report["verdict"] == "not_identifiable"
    assert any("to and fro" in line for line in report["advice"])


def test_the_found_effect_becomes_an_uncertain_factor_of_a_ranking(
    rubbing: tuple[Path, float, dict[str, Any]], tmp_path: Path
) -> None:
    folder, _, _ = rubbing
    with WarmFleet(tmp_path, workers=1) as fleet:
        submitted = subprocess.run(
            [
                *(sys.executable, "-m", "rehyb", "study", "with-effect"),
                *(str(folder / "out" / "report.json"), "--model", "elbow_bushing_effects"),
                *("--rows", "4", "--from-none", "--url", fleet.url, "--token", fleet.token),
                "--json",
            ],
            capture_output=True,
            text=True,
            check=True,
        )
        with Client(fleet.url, fleet.token) as client:
            study = json.loads(submitted.stdout)["id"]
            client.wait(study)
            ranking = client.indices(study)["outputs"]["stiffness_error"]
    measures = {name: entry["mu_star"]["value"] for name, entry in ranking["factors"].items()}
    assert len(measures) == 7
    # Friction between none and what was found matters more than the mass of the upper arm.
    assert measures["effect.coulomb_friction.torque"] > measures["upper_arm_mass"]
