"""A limb on a spring follows it near its own frequency too, and the motor is before the spring."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW

ELASTIC = BY_NAME["series_elasticity"]
RATE = 200.0
#: The shoulder, which carries the elbow.
OTHER = 0


@pytest.mark.parametrize("swinging", [0.0, 0.5])
@pytest.mark.parametrize("hertz", [2.0, 4.0, 8.0])
def test_the_column_is_what_a_limb_on_a_spring_changes(
    recording: Recording, hertz: float, swinging: float
) -> None:
    """Driven at 1 and 3 Hz: below, between and above that, the limb leads or follows.

    Whether it lies still on its spring when the recording begins or swings (rad/s): what it leaves
    says so. Where it leans on its spring with its weight, that differs from place to place. Another
    joint feels that it is elsewhere.
    """
    joint = unfitted(recording, ELBOW)
    time, stiffness, damping = recording.time, 0.8, 0.1
    load = np.cos(2 * np.pi * time) + 0.5 * np.sin(6 * np.pi * time)
    inertia = recording.inertia(ELBOW)[:, ELBOW] - recording.motor_inertia(ELBOW)
    slope = recording.secant(ELBOW, 1e-4)
    drag = recording.drag(ELBOW)
    spring = inertia.mean() * (2 * np.pi * hertz) ** 2
    own = 2 * 0.2 * np.sqrt(spring * inertia.mean())
    damped = damping + drag[:, ELBOW] - recording.motor_damping(ELBOW) + own
    held = stiffness + slope[:, ELBOW] + spring
    twist, rate, steps = load[0] / held[0], swinging, 50
    expected, felt = [], []
    for now in range(len(load)):
        mass, drags, stiff = inertia[now], damped[now], held[now]
        twice = (load[now] - drags * rate - stiff * twist) / mass
        expected.append(spring * twist + own * rate - load[now])
        felt.append(
            -recording.inertia(ELBOW)[now, OTHER] * twice
            - drag[now, OTHER] * rate
            - slope[now, OTHER] * twist
        )
        following = load[min(now + 1, len(load) - 1)]
        for part in range(steps):
            pull = load[now] + (following - load[now]) * part / steps
            rate += (pull - drags * rate - stiff * twist) / mass / RATE / steps
            twist += rate / RATE / steps
    carried, residual = np.zeros_like(recording.position), np.zeros_like(recording.position)
    carried[:, ELBOW], residual[:, ELBOW] = load, expected
    estimate = replace(
        joint.estimate,
        carried=carried,
        residual=recording.filtered(residual),
        stiffness=np.array([0.0, stiffness]),
        damping=np.array([0.0, damping]),
    )
    joint = replace(joint, estimate=estimate)
    columns = ELASTIC.columns(joint, {"resonance": hertz, "damping_ratio": 0.2})
    for number, torque in ((ELBOW, np.array(expected)), (OTHER, np.array(felt))):
        difference = columns[number][:, 0] / spring - torque
        assert np.sqrt(np.mean(difference**2)) < 0.03 * np.sqrt(np.mean(torque**2))


def test_a_limb_that_would_fall_off_its_spring_has_a_finite_column(recording: Recording) -> None:
    joint = unfitted(recording, ELBOW)
    falling = replace(
        joint.estimate, stiffness=np.array([0.0, -900.0]), damping=np.array([0.0, -5.0])
    )
    joint = replace(joint, estimate=falling)
    theta = {"resonance": 1.5, "damping_ratio": 0.05}
    (column,) = ELASTIC.columns(joint, theta)[ELBOW].T
    assert np.abs(column).max() < 1e3


def test_a_compliance_has_the_size_that_its_resonance_says(recording: Recording) -> None:
    joint, theta = unfitted(recording, ELBOW), {"resonance": 5.0, "damping_ratio": 0.2}
    assert not ELASTIC.beyond(joint, theta, {0: 0.0225})
    assert ELASTIC.beyond(joint, theta, {0: 0.08}) == "compliance"
    assert ELASTIC.beyond(joint, theta, {0: 0.005}) == "compliance"


def test_a_swing_that_is_over_before_it_shows_is_not_fitted(recording: Recording) -> None:
    """To noise at its end, it would be as large as anything at its beginning."""
    joint = unfitted(recording, ELBOW)
    noise = np.random.default_rng(0).standard_normal(recording.position.shape)
    still = replace(joint.estimate, residual=np.zeros_like(noise))
    loud = replace(joint.estimate, residual=recording.filtered(noise))
    for ratio, same in ((0.1, False), (0.9, True)):
        theta = {"resonance": 17.0, "damping_ratio": ratio}
        one, other = (
            ELASTIC.columns(replace(joint, estimate=estimate), theta)[ELBOW]
            for estimate in (still, loud)
        )
        assert np.allclose(one, other) == same
