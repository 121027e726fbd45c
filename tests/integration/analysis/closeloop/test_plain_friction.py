"""Friction that is Coulomb and viscous gets these names, of one joint, too."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.loop import close_loop

RATE, COULOMB, VISCOUS = 200.0, 0.3, 0.2


def test_one_joint_in_three_smooth_trials_has_no_asymmetric_friction(tmp_path: Path) -> None:
    """Nine of fifteen sessions of an opponent had two equal levels: each name alone is worse."""
    rng, trials = np.random.default_rng(3), []
    for number, (slow, quick) in enumerate([(0.35, 0.9), (0.3, 1.1), (0.4, 0.8)]):
        time = 20.0 * number + np.arange(int(9.0 * RATE)) / RATE
        q = 0.5 * np.sin(2 * np.pi * slow * time) + 0.15 * np.sin(2 * np.pi * quick * time)
        v, a = np.gradient(q, 1 / RATE), np.gradient(np.gradient(q, 1 / RATE), 1 / RATE)
        effort = 0.06 * a + COULOMB * np.tanh(v / 0.005) + VISCOUS * v
        effort += 0.02 * rng.standard_normal(len(time))
        name = f"t{number}.csv"
        table = np.column_stack([time, q + 2e-5 * rng.standard_normal(len(time)), effort])
        header = "time,elbow.position,elbow.effort"
        np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == 2 else "fit"})
    (tmp_path / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="elbow" axis="0 1 0"/>'
        '<inertial mass="1" pos="0 0 0" diaginertia=".06 .06 .06"/></body></worldbody></mujoco>'
    )
    content = {"schema": 1, "model": "device.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(content))
    report = close_loop(tmp_path, tmp_path / "out")
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert set(found) == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"]["torque"]["value"] == pytest.approx(COULOMB, rel=0.05)
    assert found["viscous_friction"]["damping"]["value"] == pytest.approx(VISCOUS, rel=0.08)
