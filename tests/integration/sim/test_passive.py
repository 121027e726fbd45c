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

#: An upper arm 12 % longer than the one the robot is made for.
LONG = {"upper_arm_length": 0.375}


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
    """Why that joint of NEUROExos is left out."""
    text = (FOLDER / "nesm_passive.xml").read_text()
    text = text.replace(
        "            <!-- The authors stop",
        '<joint name="passive_turn" class="hinge" axis="0 1 0" range="-20 20"/>\n'
        "            <!-- The authors stop",
    ).replace(" 0 0 0 0 ", " 0 0 0 0 0 ")
    path = tmp_path / "turning.xml"
    path.write_text(text)
    turned, held = (assess({}, device=device).record for device in (str(path), "nesm_passive"))
    assert turned is not None
    assert held is not None
    assert turned.loads.roll[:, 0].max() > 3.0 * held.loads.roll[:, 0].max()


def test_an_arm_without_friction_in_its_cuffs_is_a_named_failure() -> None:
    found = assess({"cuff_friction": 0.0}, device="nesm_passive")
    assert found.outcome in ("slipped", "penetrated"), found.reason
