"""A limb on a spring follows it near its own frequency too, and the motor is before the spring."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.loose_link import springs_apart
from sim.effects.motion import Spring
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


def test_two_springs_are_one_system_in_which_each_link_shakes_the_other(
    recording: Recording,
) -> None:
    """One added to the other adds what it changes of that one's, too; apart, each has its own."""
    joint = unfitted(recording, ELBOW)
    time = recording.time
    loads = np.column_stack([np.cos(2 * np.pi * time), 0.5 * np.sin(6 * np.pi * time)])
    thetas = {
        OTHER: {"resonance": 4.0, "damping_ratio": 0.2},
        ELBOW: {"resonance": 6.0, "damping_ratio": 0.1},
    }
    both = (OTHER, ELBOW)
    inertia, drag, held = (
        np.stack([of(number)[:, both] for number in both], axis=-1)
        for of in (recording.inertia, recording.drag, lambda number: recording.secant(number, 1e-4))
    )
    springs, own = np.zeros(2), np.zeros(2)
    for number in both:
        inertia[:, number, number] -= recording.motor_inertia(number)
        drag[:, number, number] -= recording.motor_damping(number)
        mean = inertia[:, number, number].mean()
        springs[number] = mean * (2 * np.pi * thetas[number]["resonance"]) ** 2
        own[number] = 2 * thetas[number]["damping_ratio"] * np.sqrt(springs[number] * mean)
        held[:, number, number] += springs[number]
        drag[:, number, number] += own[number]
    twist, rate, steps = np.linalg.solve(held[0], loads[0]), np.zeros(2), 50
    expected, elsewhere = [], []
    for now, load in enumerate(loads):
        twice = np.linalg.solve(inertia[now], load - drag[now] @ rate - held[now] @ twist)
        expected.append(springs * twist + own * rate - load)
        across = inertia[now] * twice + drag[now] * rate + held[now] * twist
        elsewhere.append(-across[(0, 1), (1, 0)])
        following = loads[min(now + 1, len(loads) - 1)]
        for part in range(steps):
            pull = load + (following - load) * part / steps
            there = pull - drag[now] @ rate - held[now] @ twist
            rate = rate + np.linalg.solve(inertia[now], there) / RATE / steps
            twist = twist + rate / RATE / steps
    torque, felt = np.array(expected), np.array(elsewhere)
    estimate = replace(joint.estimate, carried=loads, residual=recording.filtered(torque))

    apart = springs_apart(replace(joint, estimate=estimate), thetas)
    for number, other in (both, both[::-1]):
        assert alike(apart[other][number][:, 0] / springs[other], felt[:, number])
        assert alike(
            apart[number][number][:, 0] / springs[number], torque[:, number] - felt[:, number]
        )

    first = np.column_stack([columns[:, 0] for columns in apart[OTHER].values()]) / springs[OTHER]
    beside = replace(
        estimate,
        carried=loads + first,
        residual=estimate.residual - recording.filtered(first),
        springs={OTHER: Spring(thetas[OTHER], first)},
    )
    added = ELASTIC.columns(replace(joint, estimate=beside), thetas[ELBOW])
    for number in both:
        assert alike(added[number][:, 0] / springs[ELBOW] + first[:, number], torque[:, number])


def alike(found: np.ndarray, torque: np.ndarray) -> bool:
    difference = np.sqrt(np.mean((found - torque) ** 2))
    return bool(difference < 0.03 * np.sqrt(np.mean(torque**2)))


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
    """To noise at its end, it would be as large as anything at its beginning.

    Nor is one that is quicker than the low-pass lets through. Where a load begins at once there are
    two beginnings to choose from, and none that noise makes.
    """
    joint = unfitted(recording, ELBOW)
    for hertz, ratio, fitted in ((8.0, 0.1, True), (8.0, 0.9, False), (25.0, 0.05, False)):
        theta = {"resonance": hertz, "damping_ratio": ratio}
        found: list[np.ndarray] = []
        for seed in range(4):
            noise = np.random.default_rng(seed).standard_normal(recording.position.shape)
            loud = replace(joint.estimate, residual=recording.filtered(noise))
            column = ELASTIC.columns(replace(joint, estimate=loud), theta)[ELBOW]
            if not any(np.allclose(column, other) for other in found):
                found.append(column)
        assert len(found) == 4 if fitted else len(found) <= 2


def test_a_swing_that_is_over_before_any_sample_counts_is_not_fitted(recording: Recording) -> None:
    """Where the first seconds were lost it came out as 10^19 Nm, which no fit saw."""
    joint = unfitted(recording, ELBOW)
    noise = np.random.default_rng(0).standard_normal(recording.position.shape)
    estimate = replace(joint.estimate, residual=recording.filtered(noise))
    theta = {"resonance": 8.0, "damping_ratio": 0.1}
    disturbed = np.zeros(recording.position.shape, dtype=bool)
    for piece in recording.slices:
        disturbed[piece.start : piece.start + int(2.0 * recording.rate)] = True
    lost = replace(recording, disturbed=disturbed, cache={})
    size = [
        np.abs(ELASTIC.columns(replace(own, estimate=estimate), theta)[ELBOW]).max()
        for own in (joint, replace(joint, recording=lost))
    ]
    assert size[1] <= size[0]
