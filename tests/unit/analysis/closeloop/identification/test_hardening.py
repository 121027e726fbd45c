"""Springs of a robot's joint that harden: one name, and no wave over the angle."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.session.contents import DeclaredEffect
from sim.effects.catalogue import BY_NAME, OF_ROBOTS
from tests.testbed.sessions.coupled import measured, moving, traced, values
from tests.testbed.sessions.rich import ELBOW, rich_recording


@pytest.mark.parametrize("hardening", [12.0, -2.0])
def test_a_spring_that_hardens_or_softens_is_one_effect(hardening: float) -> None:
    still = moving()
    needed = np.array(still.inverse)
    stretch = still.position[:, 1] - 0.45
    needed[:, 1] += 0.8 * stretch + hardening * stretch**3
    robot = measured(still, needed)
    found = traced(robot)
    assert set(found) == {("nonlinear_stiffness", 1)}
    own = values(found["nonlinear_stiffness", 1], robot)
    assert own["cubic_stiffness"] == pytest.approx(hardening, rel=0.05)
    assert own["centre"] == pytest.approx(0.45, abs=0.02)
    assert own["stiffness"] == pytest.approx(0.8, rel=0.1)


def test_a_robots_declared_spring_is_fitted_whole() -> None:
    still = moving()
    needed = np.array(still.inverse)
    stretch = still.position[:, 1] - 0.45
    needed[:, 1] += 0.8 * stretch + 12.0 * stretch**3
    robot = measured(still, needed)
    declared = (DeclaredEffect(effect="nonlinear_stiffness", joint="b"),)
    robot = replace(robot, session=replace(robot.session, declared=declared))
    rows = select_rows(robot, (0,))
    model = declared_model(robot, rows)
    (term,) = model.terms
    assert term.kept == (0, 1, 2)
    cubic, stiffness, _ = evaluate(model, rows).coefficients
    assert cubic == pytest.approx(12.0, rel=0.05)
    assert stiffness == pytest.approx(0.8, rel=0.1)


def test_a_spring_that_is_a_straight_line_is_a_stiffness_as_ever() -> None:
    still = moving()
    needed = np.array(still.inverse)
    needed[:, 1] += 0.8 * (still.position[:, 1] - 0.45)
    assert set(traced(measured(still, needed))) == {("joint_stiffness", 1)}


def test_a_limb_has_its_own_law_and_a_robot_its_own() -> None:
    (spring,) = OF_ROBOTS
    limb = BY_NAME["nonlinear_stiffness"]
    both = rich_recording()
    assert limb.applies(both, ELBOW) and not spring.applies(both, ELBOW)
    assert spring.applies(both, 0) and not limb.applies(both, 0)
    assert spring.name == limb.name


def test_what_takes_in_a_spring_leaves_none_of_it() -> None:
    (spring,) = OF_ROBOTS
    joint = unfitted(moving(), 1)
    columns = spring.columns(joint, {"centre": 0.3})[1]
    for name in spring.includes:
        simple = BY_NAME[name].columns(joint, {})[1]
        held = np.linalg.lstsq(columns, simple, rcond=None)[0]
        np.testing.assert_allclose(columns @ held, simple, atol=1e-9)


def test_a_ripple_that_never_comes_back_is_named_last() -> None:
    """One period and a half may be any curve, of a robot's spring or of soft tissue."""
    both, ripple = rich_recording(), BY_NAME["torque_ripple"]
    robot = unfitted(replace(both, session=replace(both.session, limb_joints=())), ELBOW)
    once = np.pi / robot.travel[1]
    for joint in (robot, unfitted(both, ELBOW)):
        assert ripple.unlikely(joint, {"order": 1.5 * once})
        assert not ripple.unlikely(joint, {"order": 2.5 * once})
