"""A richer law of friction stays only where something needs it."""

import numpy as np
import pytest

from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.friction.plain_friction import (
    with_peaked_friction,
    with_plain_friction,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, EFFECTS
from tests.testbed.sessions.coupled import measured, moving

JOINT = 1


@pytest.mark.parametrize(
    ("backwards", "kept"),
    [
        (0.3, {"coulomb_friction", "viscous_friction"}),
        (0.5, {"asymmetric_friction"}),
    ],
    ids=["two equal levels", "two levels"],
)
def test_two_equal_levels_are_coulomb_and_viscous_friction(
    backwards: float, kept: set[str]
) -> None:
    robot = moving()
    velocity = robot.velocity[:, JOINT]
    effort = np.array(robot.inverse)
    effort[:, JOINT] += np.where(velocity > 0, 0.3, -backwards) * np.tanh(np.abs(velocity) / 0.01)
    effort[:, JOINT] += 0.2 * velocity
    loud = measured(robot, effort)
    rows = select_rows(loud, (0,))
    richer = Candidate(effect=BY_NAME["asymmetric_friction"], joint=JOINT)
    found = tried_alone(Model(loud), rows, richer)
    assert found is not None
    plain = with_plain_friction(found[0], rows)
    assert {(c.effect.name, c.joint) for c in plain.effects} == {(name, JOINT) for name in kept}


def peaked() -> tuple[Recording, Rows]:
    """A robot with friction of 0.3 Nm, 0.4 more when slow, and damping of 0.25 Nm s/rad."""
    robot = moving()
    velocity = robot.velocity
    level = 0.3 + 0.4 * np.exp(-((velocity / 0.8) ** 2))
    effort = robot.inverse + level * np.tanh(velocity / 0.02) + 0.25 * velocity
    loud = measured(robot, effort, noise=0.02)
    return loud, select_rows(loud, (0,))


def with_each(model: Model, rows: Rows, *names: str) -> Model:
    """The model with effects at the joint, found one after the other."""
    for name in names:
        found = tried_alone(model, rows, Candidate(effect=BY_NAME[name], joint=JOINT))
        assert found is not None
        model = found[0]
    return model


@pytest.mark.parametrize(
    ("other", "held"),
    [("torque_offset", 0.0), ("viscous_friction", 0.0), ("torque_offset", 0.1)],
    ids=["an offset", "damping", "what the joint has where it turns, too"],
)
def test_levels_and_slopes_that_differ_are_no_offset_or_damping_besides(
    other: str, held: float
) -> None:
    """Equal levels and an offset stood for two, since an opponent's joint stuck as it turned."""
    robot = moving()
    velocity = robot.velocity[:, JOINT]
    effort = np.array(robot.inverse)
    level = np.where(velocity > 0, 0.5 - held, -0.3 - held)
    effort[:, JOINT] += held + level * np.tanh(np.abs(velocity) / 0.01)
    effort[:, JOINT] += np.where(velocity > 0, 0.35, 0.15) * velocity
    loud = measured(robot, effort)
    rows = select_rows(loud, (0,))
    both = with_each(Model(loud), rows, other, "asymmetric_friction")
    alone = with_plain_friction(both, rows)
    assert [c.effect.name for c in alone.effects] == ["asymmetric_friction"]
    # Mean and half difference of the levels.
    coefficients = evaluate(alone, rows).coefficients
    assert coefficients[:2] == pytest.approx([0.4, 0.1], abs=0.02)


def test_friction_that_is_larger_when_slow_and_knows_no_load_goes_by_the_speed_alone() -> None:
    loud, rows = peaked()
    loaded = with_each(Model(loud), rows, "viscous_friction", "stribeck_load_friction")
    plainer = with_plain_friction(loaded, rows)
    assert {c.effect.name for c in plainer.effects} == {"viscous_friction", "stribeck_friction"}


def test_a_peak_at_low_speed_and_damping_that_hide_each_other_are_asked_together() -> None:
    """Slow ramps of an opponent's arms: neither was missed alone, and Coulomb friction stayed."""
    loud, rows = peaked()
    coulomb = Candidate(effect=BY_NAME["coulomb_friction"], joint=JOINT)
    found = tried_alone(Model(loud), rows, coulomb)
    assert found is not None
    model = with_peaked_friction(found[0], rows)
    names = {"stribeck_friction", "viscous_friction"}
    assert {(c.effect.name, c.joint) for c in model.effects} == {(name, JOINT) for name in names}
    values = {
        term.effect.name: own.tolist()
        for term, own in model.split(evaluate(model, rows).coefficients)
        if term.effect is not None
    }
    assert values["viscous_friction"] == pytest.approx([0.25], rel=0.1)
    assert values["stribeck_friction"] == pytest.approx([0.3, 0.4], rel=0.15)


def test_where_there_is_no_peak_friction_stays_plain() -> None:
    robot = moving()
    effort = robot.inverse + 0.3 * np.tanh(robot.velocity / 0.02) + 0.25 * robot.velocity
    loud = measured(robot, effort, noise=0.02)
    rows = select_rows(loud, (0,))
    model = with_ordinary(Model(loud), rows)
    again = with_peaked_friction(model, rows)
    assert {c.key for c in again.effects} == {c.key for c in model.effects}


def test_a_law_of_friction_has_the_parameters_of_every_law_that_may_take_its_place() -> None:
    for law in (effect for effect in EFFECTS if effect.rubs):
        own = {parameter.name for parameter in law.nonlinear}
        for name in law.includes:
            assert own.issuperset(parameter.name for parameter in BY_NAME[name].nonlinear)
