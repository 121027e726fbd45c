"""A load of one joint has gravity's shape and inertia's, and friction that changes has neither."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.spread import mass_and_place
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.loads.lone_joint import supposing_lone_loads
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from sim.effects.rigid import point_mass
from tests.testbed.sessions.coupled import measured
from tests.testbed.sessions.rich import swung

LEVEL = """<mujoco><worldbody><body name="arm"><joint name="a" axis="0 1 0"/>
<inertial mass="3" pos="0.2 0 0.01" diaginertia="0.004 0.04 0.04"/></body></worldbody></mujoco>"""
UPRIGHT = LEVEL.replace('axis="0 1 0"', 'axis="0 0 1"')
MASS, PLACE = 0.5, np.array([0.35, 0.0, 0.05])
TRIALS, LOADED = 3, 1


def moving(model: str = LEVEL) -> Recording:
    """Return a robot of one joint in trials of a group each."""
    plain = swung(model, (0.5,), (0.4,), 30)
    w = 2 * np.pi * 1.31
    angle = plain.time[:, None] * w
    trial = np.arange(len(plain.time)) * TRIALS // len(plain.time)
    names = [f"t{number}.csv" for number in range(TRIALS)]
    trials = tuple(Trial(file=name, label=name, group=name, role="fit") for name in names)
    return replace(
        plain,
        session=replace(plain.session, trials=trials, limb_joints=()),
        position=plain.position + 0.1 * np.sin(angle),
        velocity=plain.velocity + 0.1 * w * np.cos(angle),
        acceleration=plain.acceleration - 0.1 * w**2 * np.sin(angle),
        slices=[slice(*np.flatnonzero(trial == n)[[0, -1]] + [0, 1]) for n in range(TRIALS)],
        trial=trial,
        fit_trials=tuple(range(TRIALS)),
        cache={},
    )


def with_more(arm: Recording, more: np.ndarray, trials: tuple[int, ...]) -> Recording:
    """Return the robot with friction, and more torque in some trials, (n, 1)."""
    rubs = 0.4 * np.sign(arm.velocity) + 0.2 * arm.velocity
    effort = arm.rigid + rubs + more * np.isin(arm.trial, trials)[:, None]
    return measured(arm, effort, noise=0.05)


def load_torque(arm: Recording) -> np.ndarray:
    return np.asarray(arm.link_torque(arm.body(0)) @ (MASS * point_mass(PLACE)))


def supposed(recording: Recording) -> list[list[int]]:
    """Return the numbers of the trials that seem to carry each load."""
    trials = supposing_lone_loads(recording).session.trials
    loads = list(dict.fromkeys(trial.payload for trial in trials if trial.payload is not None))
    return [[n for n, trial in enumerate(trials) if trial.payload == load] for load in loads]


@pytest.mark.parametrize(
    ("trials", "found"),
    [((), []), ((1,), [[1]]), ((0, 2), [[0, 2]]), ((0, 1, 2), [])],
)
def test_trials_of_one_joint_with_a_load_are_told_from_those_without(
    trials: tuple[int, ...], found: list[list[int]]
) -> None:
    arm = moving()
    assert supposed(with_more(arm, load_torque(arm), trials)) == found


def test_what_is_found_has_its_mass_and_place() -> None:
    """At the link's origin, on the axis, a mass has no torque: no fit may begin and end there."""
    arm = moving()
    recording = supposing_lone_loads(with_more(arm, load_torque(arm), (LOADED,)))
    # Without its friction, which is not declared.
    more = load_torque(arm) * (arm.trial == LOADED)[:, None]
    recording = replace(recording, effort=arm.filtered(arm.rigid + more), cache={})
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    (term,) = model.terms
    mass, x, _, z = mass_and_place(model, term, evaluate(model, rows).coefficients[None])[0]
    assert (mass, x, z) == pytest.approx((MASS, PLACE[0], PLACE[2]), abs=0.02)


@pytest.mark.parametrize("changed", ["friction", "offset", "tilt", "inertia"])
def test_no_load_is_what_has_not_both_of_its_shapes(changed: str) -> None:
    arm = moving()
    more = {
        "friction": 0.6 * np.sign(arm.velocity) + 0.5 * arm.velocity,
        "offset": np.full_like(arm.velocity, 0.7),
        "tilt": 1.5 * np.cos(arm.position + 0.2),
        "inertia": 0.1 * arm.acceleration,
    }[changed]
    assert supposed(with_more(arm, more, (LOADED,))) == []


def test_about_an_upright_axis_no_load_is_told() -> None:
    arm = moving(UPRIGHT)
    assert supposed(with_more(arm, load_torque(arm), (LOADED,))) == []
