"""A declared damping that nobody measured is told, and what trials show takes its place."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import pruned, weighed
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.guessed import (
    doubtful_guesses,
    guessed_damping,
    guesses,
)
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.rubbing import VISCOUS, rubbing_robot, with_efforts
from tests.testbed.sessions.synthetic import mjcf

#: Nm s/rad, at every joint of a file.
GUESS = 20.0


@pytest.fixture(scope="module")
def robot() -> Recording:
    return rubbing_robot()


def declaring(robot: Recording, **sizes: float) -> Recording:
    """Return a recording whose model's file has further damping (or else) at both joints."""
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    for name in ("shoulder", "elbow"):
        for what, size in sizes.items():
            joint = spec.joint(name)
            setattr(joint, what, [size, 0.0, 0.0] if what == "damping" else size)
    return replace(robot, device=Device(spec, ()), cache={})


def test_nothing_is_said_of_a_robot_that_is_as_declared(robot: Recording) -> None:
    assert guesses(robot) == [] and guessed_damping(robot) == frozenset()


@pytest.mark.parametrize(
    ("what", "size"), [("damping", 40.0), ("frictionloss", 60.0), ("armature", 30.0)]
)
def test_what_alone_takes_more_than_the_effort_is_told_by_joint(
    robot: Recording, what: str, size: float
) -> None:
    said = doubtful_guesses(declaring(robot, **{what: size}))
    assert len(said) == 2 and said[0].startswith(f"shoulder: the declared {what} of {size:.3g}")
    assert "the whole effort is" in said[0] and "Leave it out of the model's file" in said[0]


def test_damping_that_the_trials_show_is_no_guess_however_little_effort_there_is(
    robot: Recording,
) -> None:
    """Gravity and a hand move a joint, too: then its motor's effort is less than its damping."""
    damped = declaring(robot, damping=GUESS)
    half = with_efforts(damped, 0.6 * GUESS * damped.velocity)
    assert not [guess for guess in guesses(half) if guess.what == "damping"]


def test_the_same_number_at_another_joint_is_as_much_of_a_guess(robot: Recording) -> None:
    loaded = declaring(robot, damping=40.0)
    efforts = np.array(loaded.effort)
    efforts[:, 0] += 200.0
    loaded = replace(loaded, effort=efforts, cache={})
    assert [guess.joint for guess in guesses(loaded)] == [1]
    assert guessed_damping(loaded) == {0, 1}


def test_a_guess_gives_way_in_trials_that_are_too_short_to_speak_against_more(
    robot: Recording,
) -> None:
    """Five seconds of a stranger's KUKA kept 10 Nm s/rad that were not there."""
    guessed = declaring(robot, damping=40.0)
    # What else is wrong is in the first of four seconds.
    wrong = 60.0 * np.sin(np.pi * np.clip(robot.time, 0.0, 1.0))[:, None]
    measured = np.where(robot.time < 4.0, robot.measured, 0.0)
    short = replace(guessed, effort=robot.effort + wrong, measured=measured, cache={})
    rows = select_rows(short, short.fit_trials)
    declared = declared_model(short, rows)
    rows = weighed(declared, rows)
    model = pruned(with_ordinary(declared, rows), rows, links_of(short))
    found = {
        (term.effect.name, term.joint): own[0]
        for term, own in model.split(evaluate(model, rows).coefficients)
        if term.effect is not None
    }
    for joint in (0, 1):
        assert found["viscous_friction", joint] == pytest.approx(VISCOUS - 40.0, abs=5.0)
