"""Joints that act on each other: by the other's motion, its acceleration or its effort."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_again
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.candidates import options_beside
from analysis.closeloop.identification.findings import Grown, Step
from analysis.closeloop.identification.growing.starts import coupled_starts
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.coupling import ACCELERATION, EFFORT, MOTION
from tests.testbed.sessions.coupled import in_trials, measured, moving, traced, values

COUPLING = BY_NAME["cross_joint_coupling"]


def of_differential(needed: np.ndarray, shares: dict[tuple[int, int], float]) -> np.ndarray:
    """Return the efforts of which each joint also feels a share of another's, (n, joints)."""
    passed = np.eye(needed.shape[1])
    for (joint, other), share in shares.items():
        passed[joint, other] = share
    return np.linalg.solve(passed, needed.T).T


def values_of(model: Model, robot: Recording) -> dict[str, float]:
    """Return the parameters of a coupling that is the only term of a model."""
    ((term, own),) = model.split(evaluate(model, select_rows(robot, (0,))).coefficients)
    read = COUPLING.readings(unfitted(robot, term.joint), term.theta)
    fitted = dict(zip(term.kept, own.tolist(), strict=True))
    return {name: float(reading.of(fitted)) for name, reading in read.items()}


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


@pytest.mark.parametrize("both", [True, False])
def test_a_muscle_over_two_joints_is_asked_for_however_little_one_of_them_lacks(both: bool) -> None:
    """A wrong zero explained more, and its 62 degrees stood: two limbs of a stranger."""
    still = moving()
    needed = np.array(still.inverse)
    needed[:, 1] += 2.0 * still.position[:, 0]
    needed[:, 0] += 2.0 * both * still.position[:, 1]
    robot = measured(still, needed)
    rows = select_rows(robot, (0,)).reweighted({0: 0.02, 1: 0.002, 2: 0.002})
    declared = Model(robot)
    before = evaluate(declared, rows)
    effects = (COUPLING, COUPLING, BY_NAME["position_offset"])
    tried = [Candidate(effect=e, joint=j) for e, j in zip(effects, (0, 1, 0), strict=True)]
    options = options_beside(declared, rows, before, tried)
    zero = next(option for option in options if option.candidate == tried[-1])
    step = Step(taken=zero, equals=(), options=tuple(options), before=before.loss)
    starts = [*coupled_starts(Grown(zero.model, zero.score, (step,)), rows, before)]
    assert [start.steps[0].key for start in starts] == [("cross_joint_coupling", 1)] * both


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


def test_a_limb_is_coupled_by_motion_and_its_sensor_by_what_the_others_feel() -> None:
    """A limb has no drive that its neighbour's motion could turn; the robot has the sensor."""
    still = moving()
    limb = replace(still, session=replace(still.session, limb_joints=("a",)), cache={})
    assert {t["by"] for t in COUPLING.thetas(unfitted(limb, 0))} == {0.0, EFFORT}
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


def test_an_effort_behind_a_declared_low_pass_is_passed_on_as_it_was_before_it() -> None:
    """The regressor passes that low-pass as every other does: once, not twice."""
    still, hertz = moving(), 6.0
    trial = replace(still.session.trials[0], effort_filter_hz=hertz)
    still = replace(still, session=replace(still.session, trials=(trial,)), cache={})
    effort = of_differential(np.array(still.inverse), {(0, 1): 0.5})
    effort = still.lagged(effort, 1.0 / (2 * np.pi * hertz))
    robot = measured(still, effort, noise=0.0)
    rows, model = select_rows(robot, (0,)), Model(robot)
    before = evaluate(model, rows)
    candidate = Candidate(effect=COUPLING, joint=0)
    (option,) = options_beside(model, rows, before, [candidate])
    assert option.theta["by"] == EFFORT
    assert option.score.loss < 1e-4 * before.loss


@pytest.mark.parametrize(("first", "right"), [(MOTION, EFFORT), (EFFORT, MOTION)])
def test_what_a_declared_coupling_goes_by_is_chosen_again(first: float, right: float) -> None:
    """Of the three columns by motion there may be one that no other law has."""
    still = moving()
    effort = np.array(still.inverse)
    if right == EFFORT:
        effort = of_differential(effort, {(0, 1): 0.4})
    else:
        effort[:, 0] += 0.8 * still.position[:, 1] + 0.3 * still.velocity[:, 1]
    robot = measured(still, effort)
    rows, joint = select_rows(robot, (0,)), unfitted(robot, 0)
    theta = {"other_dof": 1.0, "between": 0.0, "by": first}
    columns = COUPLING.columns(joint, theta)
    every = tuple(range(columns[0].shape[1]))
    term = Term(joint=0, columns=columns, kept=every, theta=theta, effect=COUPLING)
    found = declared_again(Model(robot, terms=(term,)), rows)
    assert found.terms[0].theta["by"] == right
    own = values_of(found, robot)
    expected = {"effort_share": -0.4} if right == EFFORT else {"stiffness": 0.8, "damping": 0.3}
    assert {name: own[name] for name in expected} == pytest.approx(expected, rel=0.02)


def test_a_neighbour_that_is_only_held_couples_by_no_motion() -> None:
    """It gave way by 0.1 mrad with the torque, and had a damping of 3000 Nm s/rad."""
    robot = moving()
    half = len(robot.time) // 2
    first = (np.arange(len(robot.time)) < half)[:, None]
    alone = np.where(first, [True, False, True], [False, True, False])
    swaying = 1e-4 * np.sin(7.0 * robot.time)[:, None]
    held = replace(
        robot,
        slices=[slice(0, half), slice(half, len(robot.time))],
        trial=(~first[:, 0]).astype(int),
        position=np.where(alone, robot.position, 0.3 + swaying),
        velocity=np.where(alone, robot.velocity, 0.0),
        cache={},
    )
    forms = {(theta["other_dof"], theta["by"]) for theta in COUPLING.thetas(unfitted(held, 0))}
    assert (1.0, MOTION) not in forms and (1.0, ACCELERATION) not in forms
    assert {(2.0, MOTION), (1.0, EFFORT)} <= forms


def test_a_joint_that_only_a_held_out_trial_moves_beside_another_is_no_belt() -> None:
    """A belt to a joint that rests is a spring of the joint's own, and took its place."""
    robot = in_trials(np.array([[True, False, False], [False, True, True], [True, True, True]]))
    for fit_trials, there in (((0, 1), False), ((0, 1, 2), True)):
        joint = unfitted(replace(robot, fit_trials=fit_trials), 0)
        assert any(theta["by"] == MOTION for theta in COUPLING.thetas(joint)) is there
