"""A recording in a few numbers."""

from dataclasses import replace

import numpy as np
import pytest

from sim.assessment.assess import assess
from sim.assessment.summary import Motion, RecordingError, motion_of, summarise, truth
from sim.evaluation import evaluate
from sim.models import CURVES, ESTIMATES, MODELS, TRUTHS
from sim.parameters.conditions import split
from sim.robot.device import NESM


@pytest.fixture(scope="module")
def motion() -> Motion:
    record = assess({"activation": 0.05}, fidelity="bushing").record
    assert record is not None
    return motion_of(record)


def test_it_needs_no_clock_and_no_rate_in_common_with_the_simulation(motion: Motion) -> None:
    ours = summarise(motion, NESM)
    later = replace(motion, time=motion.time + 100.0)
    assert summarise(later, NESM) == pytest.approx(ours, abs=1e-6)
    coarse = Motion(
        time=motion.time[::2],
        theta=motion.theta[::2],
        velocity=motion.velocity[::2],
        torque=motion.torque[::2],
        joint=motion.joint,
    )
    assert summarise(coarse, NESM) == pytest.approx(ours, abs=0.06)


def test_a_torque_more_is_a_torque_less_that_is_not_explained(motion: Motion) -> None:
    more = summarise(replace(motion, torque=motion.torque + 0.3), NESM)
    ours = summarise(motion, NESM)
    for name in CURVES:
        expected = ours[name] - (0.3 if name.startswith("torque") else 0.0)
        assert more[name] == pytest.approx(expected, abs=1e-9)
    assert more["affine_stiffness"] == pytest.approx(ours["affine_stiffness"], abs=1e-9)


def test_what_holds_no_movement_is_refused(motion: Motion) -> None:
    with pytest.raises(RecordingError, match=r"at least 0\.25 rad"):
        summarise(replace(motion, theta=0.1 * motion.theta), NESM)
    short = slice(0, 400)
    cut = Motion(
        time=motion.time[short],
        theta=motion.theta[short],
        velocity=motion.velocity[short],
        torque=motion.torque[short],
        joint=motion.joint,
    )
    with pytest.raises(RecordingError, match="record longer"):
        summarise(cut, NESM)


def test_a_spring_of_the_limb_is_part_of_its_stiffness() -> None:
    values = {"activation": 0.02, "muscles": "physiological", "muscle_strength": 0.05}
    found = []
    for stiffness in (0.0, 4.0):
        own = values | {"passive_stiffness": stiffness, "passive_damping": 0.2}
        assessment = assess(own, fidelity="bushing")
        assert assessment.record is not None
        found.append(truth(assessment.record, split(own)[1]))
        assert assessment.outputs["stiffness_sum"] == pytest.approx(-found[-1]["stiffness"])
    assert found[1]["stiffness"] - found[0]["stiffness"] == pytest.approx(4.0, abs=0.05)
    # The joint's own damping is 0.6 Nm s/rad; the muscles add what is left.
    assert found[0]["damping"] == pytest.approx(0.8, abs=0.2)


def test_a_study_of_recordings_has_all_of_it() -> None:
    model = MODELS["elbow_bushing_recording"]
    outputs = evaluate(model.name, {}).outputs
    assert set(outputs) == set(model.outputs)
    assert {*CURVES, *ESTIMATES, *TRUTHS} <= set(outputs)
    assert np.isfinite(list(outputs.values())).all()
