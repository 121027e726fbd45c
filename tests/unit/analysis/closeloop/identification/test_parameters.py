"""Physical parameters of what is found, and intervals that span what they cannot be."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.parameters import (
    parameters_of,
    part_of,
    spans_nonsense,
    under_both,
)
from analysis.closeloop.report.named import if_they_can_be
from sim.effects.catalogue import BY_NAME
from sim.effects.rigid import point_mass
from tests.testbed.sessions.coupled import measured, moving, traced
from tests.testbed.sessions.rich import ELBOW, TRUTH, added, rich_elbow

MASS = (0.0, float("inf"))


@pytest.mark.parametrize(
    ("interval", "value", "limits", "nonsense"),
    [
        ((-1.9, 3.3), 0.7, MASS, True),
        ((-0.02, 0.22), 0.1, MASS, False),
        ((2.7, 2.9), 2.8, MASS, False),
        # An estimate that the bound itself holds may be uncertain to both sides.
        ((-0.3, 0.3), 0.0, MASS, False),
        ((-3.0, 9.0), 1.0, (-1.6, 1.6), True),
        ((1.0, 1.0), 1.0, MASS, False),
        # Of a Kinova Gen3, metres beyond its reach.
        ((-4.5, -0.7), -2.6, (-0.9, 0.9), True),
        ((1.8, 1.9), 1.85, (-0.9, 0.9), True),
        # A share of which nearly all is known: an opponent's cuffs, whose values were withheld.
        ((0.951, 1.04), 0.995, (0.1, 1.0), False),
        ((-0.002, 0.003), 0.0006, (0.0, 0.7), False),
    ],
)
def test_an_interval_that_spans_nonsense_says_nothing(
    interval: tuple[float, float], value: float, limits: tuple[float, float], nonsense: bool
) -> None:
    assert spans_nonsense(interval, value, limits) is nonsense


def test_a_load_has_its_own_mass_beside_a_gain_of_the_joint_it_hangs_at() -> None:
    """It was told as the gain times its mass: the gain scales it as it does the links."""
    arm = moving()
    load = 0.3 * point_mass(np.array([0.15, 0.03, 0.0]))
    effort = arm.rigid + arm.link_torque(arm.body(1)) @ load
    effort[:, 1] /= 1.15
    recording = measured(arm, effort)
    (found,) = (step.taken for key, step in traced(recording).items() if key == ("payload", 1))
    rows = select_rows(recording, (0,))
    coefficients = evaluate(found.model, rows).coefficients
    fits = leave_out(found.model, rows, coefficients)
    told = parameters_of(found.model, coefficients, fits, part_of(found.model, found.candidate))
    assert told["mass"]["value"] == pytest.approx(0.3, rel=0.01)
    low, high = told["mass"]["ci90"]
    assert low <= 0.3 <= high


def test_damping_that_is_declared_too_high_is_a_difference_below_none() -> None:
    """Of a stranger's four joints the right ones were refused as beyond what damping can be."""
    arm = moving()
    arm.device.model.dof_damping[1] = 0.4
    effort = arm.rigid
    effort[:, 1] -= 0.15 * arm.velocity[:, 1]
    recording = measured(arm, effort)
    (found,) = (
        step.taken for key, step in traced(recording).items() if key == ("viscous_friction", 1)
    )
    rows = select_rows(recording, (0,))
    coefficients = evaluate(found.model, rows).coefficients
    fits = leave_out(found.model, rows, coefficients)
    told = parameters_of(found.model, coefficients, fits, part_of(found.model, found.candidate))
    assert if_they_can_be(told)["damping"]["value"] == pytest.approx(-0.15, rel=0.03)


def test_an_interval_of_a_share_ends_at_the_whole() -> None:
    """Of an opponent's cuff 0.951 to 1.04 of the inertia hung behind it."""
    elbow, effect = rich_elbow(), BY_NAME["series_elasticity"]
    theta, size = TRUTH["series_elasticity"]
    theta = {**theta, "inertia_behind": 0.97, "weight_behind": 0.97}
    columns = effect.columns(unfitted(elbow, ELBOW), theta)
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += columns[ELBOW] @ size
    effort[:, ELBOW] += 0.3 * np.random.default_rng(3).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    term = added(effect.name, columns, theta)
    model, rows = Model(loud, terms=(term,)), select_rows(loud, (0,))
    coefficients = evaluate(model, rows).coefficients
    fits = leave_out(model, rows, coefficients)
    told = parameters_of(model, coefficients, fits, term)["inertia_behind"]
    assert told["free"][1] > 1.0 and told["ci90"][1] == 1.0


def test_an_interval_holds_what_a_value_is_beside_another_name() -> None:
    """Friction beside a load that may be a gain was 0.666 to 0.667 Nm, and 0.6 beside the gain."""
    one = {
        "torque": {"value": 0.666, "ci90": [0.665, 0.668], "free": (0.665, 0.668)},
        "middle": {"value": 0.1, "ci90": None},
    }
    other = {"torque": {"ci90": [0.597, 0.6], "free": (0.597, 0.6)}}
    both = under_both(one, other)
    assert both["torque"] == {"value": 0.666, "ci90": [0.597, 0.668], "free": [0.597, 0.668]}
    assert both["middle"] == one["middle"]
