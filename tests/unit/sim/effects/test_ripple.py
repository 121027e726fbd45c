"""A ripple is looked for at the orders that stand out in the residual over position."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.nameable import beyond_physics
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.transmission import beyond_a_line
from tests.testbed.sessions.rich import ELBOW, rich_recording


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_recording()


@pytest.mark.parametrize("periods", [0.8, 1.3, 1.5, 2.3, 4.0, 20.0])
def test_a_ripple_is_looked_for_near_its_order(elbow: Recording, periods: float) -> None:
    """Few periods, too, in a motion that dwells at its ends, beside what a spring leaves."""
    joint = unfitted(elbow, ELBOW)
    middle, half = joint.travel
    order = periods * np.pi / half
    residual = np.array(joint.estimate.residual)
    residual[:, ELBOW] = 0.8 * np.sin(order * joint.position + 0.5)
    residual[:, ELBOW] += 2.0 * (joint.position - middle) + 1.0
    seen = replace(joint, estimate=replace(joint.estimate, residual=residual))
    orders = [theta["order"] for theta in BY_NAME["torque_ripple"].thetas(seen)]
    assert min(abs(found - order) for found in orders) < 0.13 * np.pi / half


@pytest.mark.parametrize(
    ("periods", "beside", "named"),
    [(1.1, [], True), (1.1, ["nonlinear_stiffness"], False), (2.3, ["nonlinear_stiffness"], True)],
)
def test_a_wave_of_less_than_two_periods_is_none_beside_what_bends_a_limb(
    elbow: Recording, periods: float, beside: list[str], named: bool
) -> None:
    """A stranger's springs that harden as a hyperbolic sine had waves beside the cubic one."""
    joint = unfitted(elbow, ELBOW)
    terms, thetas = [], {"torque_ripple": {"order": periods * np.pi / joint.travel[1]}}
    for name in (*beside, "torque_ripple"):
        effect = BY_NAME[name]
        theta = thetas.get(name) or effect.thetas(joint)[0]
        candidate, columns = Candidate(effect=effect, joint=ELBOW), effect.columns(joint, theta)
        width = next(iter(columns.values())).shape[1]
        terms.append(
            Term(
                joint=ELBOW,
                columns=columns,
                theta=theta,
                kept=tuple(range(width)),
                effect=effect,
                candidate=candidate,
            )
        )
    model, rows = Model(elbow, terms=tuple(terms)), select_rows(elbow, (0,))
    assert bool(beyond_physics(model, evaluate(model, rows), candidate)) is not named


def test_waves_that_are_a_line_explain_nothing() -> None:
    position = np.random.default_rng(0).uniform(-0.5, 0.5, 2000)
    orders = np.array([7.0, 14.0, 30.0])
    assert beyond_a_line(position, 3.0 * position - 1.0, orders) == pytest.approx(0.0, abs=1e-2)
    whole = beyond_a_line(position, np.sin(14.0 * position), orders)
    assert np.argmax(whole) == 1
