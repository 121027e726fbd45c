"""The NESM with passive joints holds arms that are not as long as it is."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim.assessment.assess import Assessment, assess
from sim.assessment.donning import HOLD
from sim.evaluation import evaluate
from sim.robot.device import FOLDER
from sim.system.system import System

#: Upper arms 12 % longer and 13 % shorter than the one the robot is made for.
LONG, SHORT = {"upper_arm_length": 0.375}, {"upper_arm_length": 0.29}


def held_by(device: str) -> tuple[Assessment, np.ndarray]:
    """Return the assessment of a long arm, and how far apart the elbows' axes are meanwhile, m."""
    apart = []

    def watch(system: System, data: mujoco.MjData) -> None:
        if data.time >= HOLD and not data.eq_active[system.locks].any():
            joint = data.joint("J4")
            between = data.body("ulna").xpos - joint.xanchor
            apart.append(np.linalg.norm(between - joint.xaxis * (between @ joint.xaxis)))

    found = assess(LONG, device=device, watch=watch)
    assert found.outcome == "ok", found.reason
    return found, np.array(apart)


def test_passive_joints_bring_axes_together_and_take_load_off_both_limbs() -> None:
    fixed, fixed_apart = held_by("nesm")
    passive, apart = held_by("nesm_passive")
    assert apart.mean() < 0.95 * fixed_apart.mean()
    assert apart[-1] < 0.8 * fixed_apart[-1]
    assert fixed.record is not None
    assert passive.record is not None
    before, after = (one.record.loads.contact_force.mean(axis=0) for one in (fixed, passive))
    assert after[0] < 0.9 * before[0]
    assert after[1] < 0.5 * before[1]
    assert abs(passive.outputs["stiffness_error"]) < abs(fixed.outputs["stiffness_error"])


def test_a_study_can_name_it_and_bushings_hold_the_arm_in_it_too() -> None:
    contact = evaluate("elbow_passive", {})
    assert contact.outcome == "ok", contact.reason
    bushing = assess({}, device="nesm_passive", fidelity="bushing")
    assert bushing.outcome == "ok", bushing.reason
    true = contact.outputs["stiffness_true"]
    assert bushing.outputs["stiffness_true"] == pytest.approx(true, abs=0.8)


def test_a_free_turn_in_line_with_j3_lets_the_cuff_turn_round_the_arm(tmp_path: Path) -> None:
    """Why that joint of NEUROExos is left out; and detectors see what passive joints do."""
    text = (FOLDER / "nesm_passive.xml").read_text()
    text = text.replace(
        '<joint name="passive_frontal"',
        '<joint name="passive_turn" class="hinge" axis="0 1 0" range="-20 20"/>\n'
        '            <joint name="passive_frontal"',
    ).replace(" 0 0 0 0 ", " 0 0 0 0 0 ")
    path = tmp_path / "turning.xml"
    path.write_text(text)
    found = assess(SHORT, device=str(path))
    assert assess(SHORT, device="nesm_passive").outcome == "ok"
    assert found.outcome == "slipped"
    assert "turned" in found.reason
