"""A limb at the elbow of a device that moves the shoulder, too: what one does to the other."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.loop import analyse
from tests.testbed.sessions.limbs import STIFFNESS
from tests.testbed.sessions.plants import ARM, write_recordings

DAMPING, NEUTRAL = 0.3, 1.2
BELT = 1.0


def written(folder: Path, belt: float = 0.0) -> None:
    """Write a session of the arm with a limb at its elbow, and a belt between both, Nm/rad."""

    def limb(_time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        own = -STIFFNESS * (q[1] - NEUTRAL) - DAMPING * v[1]
        stretched = belt * (q[0] - q[1])
        return np.array([-stretched, own + stretched])

    write_recordings(folder, ARM, 1, beyond=limb)
    session = json.loads((folder / "session.json").read_text())
    session["declared_effects"] = [{"effect": "viscoelastic_joint", "joint": "elbow"}]
    (folder / "session.json").write_text(json.dumps(session))


def stiffness(report: dict[str, Any], joint: str = "elbow") -> dict[str, Any]:
    found: dict[str, Any] = report["impedance"][joint]["stiffness"]
    return found


def test_a_torque_sensor_that_feels_the_other_joints_is_coupling_by_effort(tmp_path: Path) -> None:
    """It was gravity, a gain and an inertia, and K 35 % off (a stranger's)."""
    written(tmp_path)
    for file in tmp_path.glob("*.csv"):
        header, *_ = file.read_text().splitlines()
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        shoulder, elbow = (header.split(",").index(f"{joint}.effort") for joint in ARM.joints)
        table[:, elbow] += 0.1 * table[:, shoulder]
        np.savetxt(file, table, "%.9g", ",", header=header, comments="")
    report = analyse(tmp_path).report
    (found,) = report["effects"]
    assert (found["name"], found["joint"]) == ("cross_joint_coupling", "elbow")
    assert found["parameters"]["effort_share"]["value"] == pytest.approx(0.1, abs=0.005)
    assert stiffness(report)["after"] == pytest.approx(STIFFNESS, rel=0.02)


def test_how_much_of_a_stiffness_is_a_belts_nobody_knows(tmp_path: Path) -> None:
    """A third of K was a belt's own, and K said to be identified (a stranger's)."""
    written(tmp_path, BELT)
    report = analyse(tmp_path).report
    assert ("cross_joint_coupling", "elbow") in {
        (effect["name"], effect["joint"]) for effect in report["effects"]
    }
    found = stiffness(report)
    assert found["after"] == pytest.approx(STIFFNESS + BELT, rel=0.03)
    low, high = found["ci90_after"]
    assert low < STIFFNESS < STIFFNESS + BELT < high
    assert not report["identified"]["elbow"]["stiffness"]
    assert any("between" in name for name in found["after_if"])


def test_a_muscle_over_both_joints_is_a_coupling_at_each(tmp_path: Path) -> None:
    """It was a wrong zero of the shoulder by 1 rad, and K there below none (a stranger's)."""
    muscle, own = 2.2, np.array([5.1, 3.9])

    def limbs(_time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        stretched = muscle * (q.sum() - 1.0)
        return np.asarray(-own * (q - [0.2, NEUTRAL]) - DAMPING * v - stretched)

    write_recordings(tmp_path, ARM, 1, beyond=limbs)
    session = json.loads((tmp_path / "session.json").read_text())
    session["declared_effects"] = [
        {"effect": "viscoelastic_joint", "joint": joint} for joint in ARM.joints
    ]
    (tmp_path / "session.json").write_text(json.dumps(session))
    report = analyse(tmp_path).report
    found = {(e["name"], e["joint"]): e["parameters"]["stiffness"] for e in report["effects"]}
    assert set(found) == {("cross_joint_coupling", joint) for joint in ARM.joints}
    for joint, known in zip(ARM.joints, own, strict=True):
        assert found["cross_joint_coupling", joint]["value"] == pytest.approx(muscle, rel=0.03)
        entry = stiffness(report, joint)
        assert entry["after"] == pytest.approx(known + muscle, rel=0.03)
        assert entry["ci90_after"][0] < known and not report["identified"][joint]["stiffness"]
        assert f"cross_joint_coupling (between -1) of {joint}" in entry["after_if"]
