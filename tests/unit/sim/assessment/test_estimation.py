"""The three regressions and the detectors around them."""

import numpy as np
import pytest
from scipy.stats import linregress

from sim.assessment.estimation import IllConditionedError, estimate_forms, fit
from sim.parameters.conditions import DEFAULT_CONDITIONS
from sim.robot.control import DURATION, extension_reference
from sim.robot.device import NESM

TIME = np.arange(0.0, DURATION, 0.01)
ANGLE, VELOCITY = extension_reference(
    TIME,
    start=NESM.start("elbow").angles[3],
    amplitude=DEFAULT_CONDITIONS.movement_amplitude,
    rate=DEFAULT_CONDITIONS.movement_rate,
)


def test_stiffness_and_damping_of_a_viscoelastic_joint_are_found() -> None:
    result = fit(6.0 * ANGLE - 4.0 * VELOCITY + 2.0, ANGLE, VELOCITY, damping=True, constant=True)
    assert (result.stiffness, result.damping) == pytest.approx((6.0, -4.0))
    assert result.r_squared == pytest.approx(1.0)
    assert result.residual_rms == pytest.approx(0.0, abs=1e-9)


def test_without_damping_the_fit_is_the_straight_line_of_scipy() -> None:
    torque = 5.0 * ANGLE + np.random.default_rng(0).normal(0.0, 0.3, ANGLE.shape)
    line = linregress(ANGLE, torque)
    result = fit(torque, ANGLE, VELOCITY, damping=False, constant=True)
    assert result.stiffness == pytest.approx(line.slope)
    assert result.r_squared == pytest.approx(line.rvalue**2)
    assert result.damping is None


def test_equation_21_to_the_letter_has_no_neutral_angle() -> None:
    torque = 6.0 * (ANGLE + 0.5)
    literal = fit(torque, ANGLE, VELOCITY, damping=True, constant=False)
    expected, *_ = np.linalg.lstsq(np.column_stack([ANGLE, VELOCITY]), torque, rcond=None)
    assert (literal.stiffness, literal.damping) == pytest.approx(tuple(expected))
    assert literal.stiffness > 6.5


def test_an_arm_that_does_not_move_is_refused() -> None:
    still = np.full(50, 1.2)
    with pytest.raises(IllConditionedError, match="does not tell stiffness"):
        fit(still, still, np.zeros(50), damping=True, constant=True)


def test_each_form_compares_estimate_and_truth_of_the_same_shape() -> None:
    q, q_velocity = 0.9 * ANGLE + 0.1, 0.9 * VELOCITY
    muscle = 7.0 * q - 3.0 * q_velocity + 1.0
    forms = estimate_forms(
        theta=ANGLE,
        theta_velocity=VELOCITY,
        q=q,
        q_velocity=q_velocity,
        inferred_torque=muscle,
        published_torque=muscle + 0.5 * q,
        muscle_torque=muscle,
    )
    assert set(forms) == {"affine", "paper", "authors"}
    estimate, truth = forms["affine"]
    assert (estimate.stiffness, truth.stiffness) == pytest.approx((6.3, 7.0))
    estimate, truth = forms["authors"]
    assert estimate.stiffness - truth.stiffness == pytest.approx(0.5)


def test_the_reference_starts_at_the_start_and_extends_smoothly() -> None:
    assert ANGLE[0] == pytest.approx(NESM.start("elbow").angles[3])
    assert np.degrees(ANGLE[-1]) == pytest.approx(10.7, abs=0.1)
    assert np.all(np.diff(ANGLE) < 0.0)
    assert np.gradient(ANGLE, TIME)[1:-1] == pytest.approx(VELOCITY[1:-1], abs=1e-3)
