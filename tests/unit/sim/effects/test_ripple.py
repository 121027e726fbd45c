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


@pytest.mark.parametrize(
    ("periods", "limb"), [(1.3, False), (1.5, False), (2.3, True), (4.0, True), (20.0, True)]
)
def test_a_ripple_is_looked_for_near_its_order(
    elbow: Recording, periods: float, limb: bool
) -> None:
    """Few periods, too, in a motion that dwells at its ends, beside what a spring leaves."""
    orders, order, half = looked_for(elbow, periods, limb=limb)
    assert min(abs(found - order) for found in orders) < 0.13 * np.pi / half


def test_a_wave_of_less_than_two_periods_is_a_limb_s_curve(elbow: Recording) -> None:
    """A stranger's springs that harden as a hyperbolic sine had waves beside the cubic one."""
    orders, order, half = looked_for(elbow, 1.1, limb=True)
    least = 2.0 * np.pi / half
    assert all(found > 0.9 * least for found in orders)
    ripple = BY_NAME["torque_ripple"]
    assert ripple.beyond(unfitted(elbow, ELBOW), {"order": order}, {}) == "order"
    assert not ripple.beyond(unfitted(elbow, ELBOW), {"order": 1.01 * least}, {})


def looked_for(
    recording: Recording, periods: float, *, limb: bool
) -> tuple[list[float], float, float]:
    """Return the orders looked for where a wave is, its own, and half the travel."""
    if not limb:
        session = replace(recording.session, limb_joints=())
        recording = replace(recording, session=session, cache={})
    joint = unfitted(recording, ELBOW)
    middle, half = joint.travel
    order = periods * np.pi / half
    residual = np.array(joint.estimate.residual)
    residual[:, ELBOW] = 0.8 * np.sin(order * joint.position + 0.5)
    residual[:, ELBOW] += 2.0 * (joint.position - middle) + 1.0
    seen = replace(joint, estimate=replace(joint.estimate, residual=residual))
    return [theta["order"] for theta in BY_NAME["torque_ripple"].thetas(seen)], order, half


def test_waves_that_are_a_line_explain_nothing() -> None:
    position = np.random.default_rng(0).uniform(-0.5, 0.5, 2000)
    orders = np.array([7.0, 14.0, 30.0])
    assert beyond_a_line(position, 3.0 * position - 1.0, orders) == pytest.approx(0.0, abs=1e-2)
    whole = beyond_a_line(position, np.sin(14.0 * position), orders)
    assert np.argmax(whole) == 1
