"""The project's own nominal arm as the declared model."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.loop import analyse
from sim.assessment.nominal import nominal_model, nominal_spec
from sim.robot.control import DURATION, extension_reference
from sim.robot.device import JOINTS
from tests.testbed.sessions.closed import closed_without_page

STIFFNESS, DAMPING, NEUTRAL = 5.0, 0.5, 1.0


def write(folder: Path, motions: list[np.ndarray], friction: float) -> None:
    """Write a session of the nominal arm whose elbow moves; (3, n) at 200 Hz each."""
    rng = np.random.default_rng(4)
    trials = []
    for number, (q, v, a) in enumerate(motions):
        t = np.arange(len(q)) / 200.0
        position = np.tile([0.0, -np.pi / 2, 0.0, 0.0], (len(t), 1))
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        position[:, 3], velocity[:, 3], acceleration[:, 3] = q, v, a
        effort = nominal_model().inverse_dynamics(position, velocity, acceleration)
        effort += STIFFNESS * (q - NEUTRAL) + DAMPING * v + friction * np.tanh(v / 0.005)
        effort += 0.1 * rng.standard_normal(len(t))
        names = ["time", *(f"{joint}.position" for joint in JOINTS), "J4.effort"]
        table = np.column_stack([t + 20.0 * number, position, effort])
        path = folder / f"{number}.csv"
        np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
        trials.append({"file": path.name})
    session = {
        "schema": 1,
        "model": "nominal",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "J4"}],
        "trials": trials,
    }
    (folder / "session.json").write_text(json.dumps(session))


def test_friction_in_the_exoskeletons_elbow_is_traced_with_the_nominal_arm(tmp_path: Path) -> None:
    friction, motions = 2.79, []
    for speed in (0.4, 0.9, 1.6):
        t, w = np.arange(0.0, 12.0, 0.005), speed / 0.7
        motions.append(
            np.array(
                [1.1 - 0.7 * np.cos(w * t), 0.7 * w * np.sin(w * t), 0.7 * w**2 * np.cos(w * t)]
            )
        )
    write(tmp_path, motions, friction)
    report = closed_without_page(tmp_path, tmp_path / "out")
    assert [effect["name"] for effect in report["effects"]] == ["coulomb_friction"]
    found = report["effects"][0]["parameters"]["torque"]["value"]
    assert found == pytest.approx(friction, rel=0.03)
    after = report["impedance"]["J4"]["stiffness"]["after"]
    assert after == pytest.approx(STIFFNESS, rel=0.015)


@pytest.mark.parametrize("friction", [0.0, 2.79])
def test_the_papers_single_sigmoid_names_nothing_and_asks_for_another_trial(
    tmp_path: Path, friction: float
) -> None:
    t = np.arange(0.0, DURATION, 0.005)
    q, v = extension_reference(t, start=1.6, amplitude=1.6 / 1.1, rate=2.0)
    write(tmp_path, [np.array([q, v, np.gradient(v, 0.005)])], friction)
    report = analyse(tmp_path).report
    assert report["verdict"] == "not_identifiable"
    # One way, K, D and q0 hide what friction does: a name would be a guess, so the trial is named.
    assert all(effect["indistinguishable_from"] for effect in report["effects"])
    assert any("to and fro" in line and "speeds" in line for line in report["advice"])
    error = report["error"]["fit"]["J4"]
    assert error["after"] == error["before"]


def test_a_taller_and_heavier_subject_has_a_longer_and_heavier_arm() -> None:
    usual, other = (
        nominal_spec(height_m=height, mass_kg=mass).compile()
        for height, mass in ((1.75, 70.0), (1.93, 84.0))
    )
    name = "forearm_tissue"
    assert other.body(name).pos[0] == pytest.approx(usual.body(name).pos[0] * 1.93 / 1.75)
    # Upper arm 2.25 kg and forearm 1.31 kg with their tissue.
    heavier = other.body_subtreemass[0] - usual.body_subtreemass[0]
    assert heavier == pytest.approx((2.25 + 1.31) * (84.0 / 70.0 - 1.0), rel=2e-3)
