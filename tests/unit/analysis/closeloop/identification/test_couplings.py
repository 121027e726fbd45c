"""Joints that act on each other: by the other's motion, its acceleration or its effort."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.robot import traced_robot, weighed
from analysis.closeloop.identification.balance.model import Candidate, Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import options_beside
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.coupling import ACCELERATION, EFFORT
from tests.testbed.sessions.rich import swung

COUPLING = BY_NAME["cross_joint_coupling"]
#: Two hinges that gravity loads, and a slide along the first's axis, which it does not.
CHAIN = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body pos=".2 0 0"><joint name="b" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body pos=".2 0 0"><joint name="c" type="slide" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
</body></body></body></worldbody></mujoco>"""
NOISE = 0.002


def moving() -> Recording:
    """Every joint in two frequencies: in one, acceleration is position."""
    plain = swung(CHAIN, (0.2, 0.4, -0.3), (0.7, 0.4, 0.55), 20)
    session = replace(plain.session, limb_joints=())
    w = 2 * np.pi * np.array([1.31, 1.73, 1.13])
    angle = plain.time[:, None] * w
    return replace(
        plain,
        session=session,
        position=plain.position + 0.1 * np.sin(angle),
        velocity=plain.velocity + 0.1 * w * np.cos(angle),
        acceleration=plain.acceleration - 0.1 * w**2 * np.sin(angle),
        cache={},
    )


def measured(recording: Recording, effort: np.ndarray, noise: float = NOISE) -> Recording:
    loud = effort + noise * np.random.default_rng(4).standard_normal(effort.shape)
    return replace(recording, effort=recording.filtered(loud), unfiltered=loud, cache={})


def of_differential(needed: np.ndarray, shares: dict[tuple[int, int], float]) -> np.ndarray:
    """Return the efforts of which each joint also feels a share of another's, (n, joints)."""
    passed = np.eye(needed.shape[1])
    for (joint, other), share in shares.items():
        passed[joint, other] = share
    return np.linalg.solve(passed, needed.T).T


def traced(recording: Recording) -> dict[tuple[str, int], Step]:
    rows = select_rows(recording, (0,))
    found = traced_robot(Model(recording), weighed(Model(recording), rows), lambda _: None)
    return {step.key: step for step in found.steps}


def values(step: Step, recording: Recording) -> dict[str, float]:
    """Return the parameters that were found for a coupling."""
    candidate = step.taken.candidate
    model, score = step.taken.model, evaluate(step.taken.model, select_rows(recording, (0,)))
    for term, own in model.split(score.coefficients):
        if term.candidate == candidate:
            read = COUPLING.readings(unfitted(recording, candidate.joint), term.theta)
            found = dict(zip(term.kept, own.tolist(), strict=True))
            return {name: float(r.of(found)) for name, r in read.items() if r.columns <= set(found)}
    raise AssertionError(candidate.key)


def test_a_coupling_by_effort_is_found_both_ways_and_is_no_gain() -> None:
    """As of a differential; one joint rubs, and that the other feels too."""
    still = moving()
    needed = np.array(still.inverse)
    needed[:, 1] += 0.3 * np.tanh(still.velocity[:, 1] / 0.02)
    robot = measured(still, of_differential(needed, {(0, 1): 0.4, (1, 0): 0.06}))
    found = traced(robot)
    assert set(found) == {
        ("cross_joint_coupling", 0),
        ("cross_joint_coupling", 1),
        ("coulomb_friction", 1),
    }
    for (joint, other), share in {(0, 1): 0.4, (1, 0): 0.06}.items():
        own = values(found["cross_joint_coupling", joint], robot)
        assert own["other_dof"] == other
        assert own["effort_share"] == pytest.approx(-share, rel=0.02)


def test_a_rotor_on_another_link_couples_both_joints_by_inertia_and_changes_no_link() -> None:
    still = moving()
    needed = np.array(still.inverse)
    needed[:, 0] += 0.05 * still.acceleration[:, 1]
    needed[:, 1] += 0.05 * still.acceleration[:, 0]
    robot = measured(still, needed)
    found = traced(robot)
    assert set(found) == {("cross_joint_coupling", 0), ("cross_joint_coupling", 1)}
    for step in found.values():
        assert values(step, robot)["inertia"] == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize("effect", ["torque_gain", "added_inertia"])
def test_what_a_joint_does_by_itself_is_no_coupling(effect: str) -> None:
    still = moving()
    needed = np.array(still.inverse)
    own = {"torque_gain": 0.2 * needed[:, 0], "added_inertia": 0.1 * still.acceleration[:, 0]}
    needed[:, 0] += own[effect]
    assert set(traced(measured(still, needed))) == {(effect, 0)}


def test_the_noise_of_the_other_effort_hardly_makes_its_share_smaller() -> None:
    """A hundredth of the effort at each sample, of which the low-pass leaves a third."""
    still = moving()
    effort = of_differential(np.array(still.inverse), {(0, 1): 0.5})
    robot = measured(still, effort, noise=0.01 * float(np.std(effort[:, 1])))
    rows, model = select_rows(robot, (0,)), Model(robot)
    candidate = Candidate(effect=COUPLING, joint=0)
    (option,) = options_beside(model, rows, evaluate(model, rows), [candidate])
    assert option.theta["by"] == EFFORT
    assert option.score.coefficients[0] == pytest.approx(-0.5, rel=0.005)


def test_an_effort_that_is_not_recorded_explains_no_other() -> None:
    still = moving()
    effort = of_differential(np.array(still.inverse), {(0, 1): 0.5})
    effort[:, 1] = np.nan
    joint = unfitted(replace(still, effort=effort, cache={}), 0)
    assert {(t["other_dof"], t["by"]) for t in COUPLING.thetas(joint) if t["by"] == EFFORT} == {
        (2.0, EFFORT)
    }


def test_a_limb_is_coupled_by_motion_alone() -> None:
    still = moving()
    limb = replace(still, session=replace(still.session, limb_joints=("a",)), cache={})
    assert {t["by"] for t in COUPLING.thetas(unfitted(limb, 0))} == {0.0}
    assert {t["by"] for t in COUPLING.thetas(unfitted(limb, 1))} == {0.0, ACCELERATION, EFFORT}


def test_a_hinge_and_a_slide_have_units_of_both_and_no_belt_between() -> None:
    joint = unfitted(moving(), 0)
    to_slide = [t for t in COUPLING.thetas(joint) if t["other_dof"] == 2.0]
    assert {t["between"] for t in to_slide} == {0.0}
    theta = to_slide[0]
    units = [
        COUPLING.unit_of(name, theta, joint)
        for name in ("stiffness", "damping", "inertia", "effort_share", "torque_at_zero")
    ]
    assert units == ["Nm/m", "Nm s/m", "kg m", "m", "Nm"]
    back = {**theta, "other_dof": 0.0}
    of_slide = unfitted(moving(), 2)
    assert COUPLING.unit_of("effort_share", back, of_slide) == "1/m"
    assert COUPLING.unit_of("torque_at_zero", back, of_slide) == "N"
