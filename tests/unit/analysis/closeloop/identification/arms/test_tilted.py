"""A base that stands askew is one thing, and no wrong zeros and springs of its arm's joints."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.arms.robot import traced_robot, weighed
from analysis.closeloop.identification.arms.tilted import TURNED, with_tilt
from analysis.closeloop.identification.balance.model import Model, evaluate, impedances, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.tracing import trace
from analysis.closeloop.report.named import where
from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, VISCOELASTIC
from tests.testbed.sessions.coupled import measured, moving
from tests.testbed.sessions.rich import swung

#: An upright hinge with two level ones behind it.
UPRIGHT = """<mujoco><worldbody>
<body name="one"><joint name="a" axis="0 0 1"/><geom size=".05" pos=".05 0 .1"/>
<body name="two" pos="0 0 .2"><joint name="b" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body name="three" pos=".2 0 0"><joint name="c" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
</body></body></body></worldbody></mujoco>"""
#: Two upright hinges: a limb on a table.
FLAT = """<mujoco><worldbody>
<body name="one"><joint name="a" axis="0 0 1"/><geom size=".05" pos=".15 0 0"/>
<body name="two" pos=".3 0 0"><joint name="b" axis="0 0 1"/><geom size=".05" pos=".12 0 0"/>
</body></body></worldbody></mujoco>"""
#: Gravity beside the declared one, m/s2: of a base that leans over by 4 degrees.
ASKEW = np.array([0.684, 0.0, 0.024])


def found(recording: Recording) -> tuple[Grown, Grown]:
    """Return what is found joint by joint, and with the base asked."""
    declared = Model(recording)
    rows = weighed(declared, select_rows(recording, (0,)))
    grown = traced_robot(declared, rows, lambda _: None)
    return grown, with_tilt(grown, rows)


def test_gravity_of_another_direction_takes_the_place_of_all_that_stood_for_it() -> None:
    """A stranger's arm had a spring at its upright axis and a wrong zero beyond it."""
    arm = moving(UPRIGHT)
    effort = arm.rigid + np.column_stack([arm.weight(joint) @ ASKEW for joint in range(3)])
    effort[:, 1] += 0.05 * np.tanh(arm.velocity[:, 1] / 0.01)
    before, after = found(measured(arm, effort))
    assert len(before.steps) > 2
    assert sorted(step.key for step in after.steps) == [
        ("coulomb_friction", 1),
        ("gravity_torque", 0),
    ]
    *_, (_, gravity) = after.model.split(after.score.coefficients)
    assert gravity == pytest.approx(ASKEW, abs=0.01)


def test_limbs_whose_base_stands_askew_feel_it_at_every_joint() -> None:
    """It was found at one, and the stiffness of the next was 0.4 Nm/rad off and identified."""
    arm = moving(UPRIGHT)
    limbs = replace(arm, session=replace(arm.session, limb_joints=("a", "b", "c")), cache={})
    effort = limbs.rigid + np.column_stack([limbs.weight(joint) @ ASKEW for joint in range(3)])
    noisy = measured(limbs, effort)
    rows, one, reflex = select_rows(noisy, (0,)), BY_NAME["gravity_torque"], "stretch_reflex"
    model = Model(noisy)
    candidate = Candidate(effect=one, joint=1)
    there, score = tried_alone(model, rows, candidate) or (model, evaluate(model, rows))
    taken = Option(candidate=candidate, model=there, score=score, gain=1.0, z=9.0)
    step = Step(taken=taken, equals=(), options=(), before=1.0)
    # Beside it stays what no gravity stands for.
    other = replace(
        step, taken=replace(taken, candidate=Candidate(effect=BY_NAME[reflex], joint=2))
    )
    after = with_tilt(Grown(there, score, (other, step)), rows)
    assert [step.key for step in after.steps] == [(reflex, 2), ("gravity_torque", 0)]
    *_, (term, gravity) = after.model.split(after.score.coefficients)
    assert term.effect is TURNED and gravity == pytest.approx(ASKEW, abs=0.01)


def test_limbs_that_feel_a_tilt_at_no_joint_enough_to_name_it_feel_it_together() -> None:
    """Nothing was named, and the first joint's stiffness stayed 12 % off: a stranger's."""
    plain = swung(FLAT, (1.2, 0.6), (0.7, 0.4), 20, rate=100.0)
    declared = [DeclaredEffect(effect=VISCOELASTIC.name, joint=joint) for joint in "ab"]
    session = replace(plain.session, limb_joints=("a", "b"), declared=tuple(declared))
    arm, stiffness = replace(plain, session=session, cache={}), np.array([8.7, 7.9])
    gravity = np.array([1.2, 0.97, 0.0])
    effort = arm.rigid + np.column_stack([arm.weight(joint) @ gravity for joint in range(2)])
    effort += stiffness * (arm.position - 1.0) + np.array([0.4, 0.15]) * arm.velocity
    told = trace(measured(arm, effort, 0.01))
    assert [step.key for step in told.steps] == [("gravity_torque", 0)]
    assert told.verdict == Verdict.EFFECT_FOUND
    each = impedances(*told.fits[1])
    assert [each[joint]["stiffness"] for joint in range(2)] == pytest.approx(stiffness, abs=0.02)


def test_a_wrong_zero_of_one_joint_is_left_what_it_is() -> None:
    arm = moving()
    offset = 0.08
    columns = BY_NAME["position_offset"].columns(unfitted(arm, 1), {"offset": offset})
    effort = np.array(arm.rigid)
    for joint, column in columns.items():
        effort[:, joint] += offset * column[:, 0]
    before, after = found(measured(arm, effort))
    assert before is after and ("position_offset", 1) in {step.key for step in after.steps}


def test_the_repaired_model_has_the_gravity_that_was_found() -> None:
    spec = mujoco.MjSpec.from_string(UPRIGHT)
    values = dict(zip(TURNED.parameters, ASKEW.tolist(), strict=True))
    assert TURNED.add(spec, "a", values) == TURNED.element
    assert spec.compile().opt.gravity == pytest.approx(ASKEW - [0.0, 0.0, 9.81])
    del values["gravity_y"]
    assert TURNED.add(spec, "a", {**values, "gravity_z": None}) == TURNED.element
    assert spec.compile().opt.gravity == pytest.approx([2.0 * ASKEW[0], 0.0, ASKEW[2] - 9.81])
    entry = {"name": TURNED.name, "joint": "a", "mujoco_element": TURNED.element}
    assert where(entry) == "the base"
    assert where({**entry, "mujoco_element": "applied torque"}) == "a"
