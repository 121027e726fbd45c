"""A ripple is looked for at the orders that stand out in the residual over position."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.transmission import beyond_a_line
from tests.testbed.sessions.rich import ELBOW, rich_recording


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_recording()


@pytest.mark.parametrize("periods", [1.3, 1.5, 4.0, 20.0])
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


def test_waves_that_are_a_line_explain_nothing() -> None:
    position = np.random.default_rng(0).uniform(-0.5, 0.5, 2000)
    orders = np.array([7.0, 14.0, 30.0])
    assert beyond_a_line(position, 3.0 * position - 1.0, orders) == pytest.approx(0.0, abs=1e-2)
    whole = beyond_a_line(position, np.sin(14.0 * position), orders)
    assert np.argmax(whole) == 1
