"""The same assessment on the shoulder's joints: another axis, other muscles."""

import mujoco
import numpy as np
import pytest

from sim.assessment.assess import assess
from sim.parameters.target import TARGETS
from sim.parameters.wearer import NOMINAL_WEARER
from sim.system.build import build_system
from sim.system.start import reset_to_start
from tests.testbed.assessments import Assess

SHOULDER = sorted(set(TARGETS) - {"elbow"})


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_both_upper_arms_coincide_at_every_start(name: str) -> None:
    system = build_system(NOMINAL_WEARER, target=TARGETS[name])
    data = reset_to_start(system)
    mujoco.mj_kinematics(system.model, data)
    humerus = data.body("humerus").xmat.reshape(3, 3)
    link = data.body("link_3").xmat.reshape(3, 3)
    # Along the arm, out of the cuff's opening, towards its upper wall.
    assert humerus == pytest.approx(
        np.column_stack([link[:, 2], -link[:, 1], link[:, 0]]), abs=1e-9
    )


@pytest.mark.parametrize("name", SHOULDER)
def test_the_nominal_shoulder_can_be_assessed_and_its_stiffness_is_found(
    assessed: Assess, name: str
) -> None:
    assessment = assessed({}, target=name)
    assert assessment.outcome == "ok", assessment.reason
    error = assessment.outputs["stiffness_error"]
    assert abs(error) < 0.35 * abs(assessment.outputs["stiffness_true"])
    assert assessment.record is not None
    moved = np.ptp(assessment.record.theta, axis=0)
    assert np.argmax(moved) == TARGETS[name].joint


@pytest.mark.parametrize("name", SHOULDER)
def test_contact_and_bushings_agree_on_the_shoulders_true_stiffness(
    assessed: Assess, name: str
) -> None:
    contact, bushing = (assessed({}, target=name, fidelity=f) for f in ("campaign", "bushing"))
    assert bushing.outputs["stiffness_true"] == pytest.approx(
        contact.outputs["stiffness_true"], rel=0.1, abs=0.1
    )


def test_more_co_contraction_is_a_stiffer_shoulder(assessed: Assess) -> None:
    weak, strong = (
        assessed({"activation": a}, target="shoulder_flexion", fidelity="bushing")
        for a in (0.3, 0.5)
    )
    assert strong.outputs["stiffness_true"] > weak.outputs["stiffness_true"] + 0.5


def test_an_unknown_joint_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="unknown target 'wrist': expected one of elbow"):
        assess({}, target="wrist")
