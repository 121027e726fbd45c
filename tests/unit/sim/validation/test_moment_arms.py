"""Moment arms beside those measured."""

import numpy as np
import pytest

from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.validation.moment_arms import ANGLES_DEG, PIGEON, SUGISAKI, measured_mm, moment_arms_mm


def test_measured_moment_arms_are_those_of_the_publication() -> None:
    """Pigeon et al. 1996: at a right angle biceps 48, brachialis 30, brachioradialis 69 mm."""
    at_90 = {muscle: measured_mm(muscle)[ANGLES_DEG == 90.0][0] for muscle in PIGEON}
    expected = {"biceps": 48.3, "brachialis": 30.3, "brachioradialis": 68.7, "triceps": -19.0}
    assert at_90 == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("name", ELBOW_MUSCLES)
def test_flexors_flex_and_extensors_extend_as_far_as_cadavers_do(name: str) -> None:
    arms = moment_arms_mm(ELBOW_MUSCLES[name])
    for muscle, ours in arms.items():
        assert np.sign(ours[40]) == np.sign(measured_mm(muscle)[40])
        # The two heads of the published biceps are farthest from it.
        assert np.abs(ours - measured_mm(muscle)).max() < 20.0, muscle


def test_only_the_papers_triceps_lies_outside_what_is_measured_in_living_people() -> None:
    outside = {
        name
        for name, elbow in ELBOW_MUSCLES.items()
        for angle, (mean, deviation) in SUGISAKI.items()
        if abs(moment_arms_mm(elbow)["triceps"][angle == ANGLES_DEG][0] - mean) > 2.0 * deviation
    }
    assert outside == {"paper"}
