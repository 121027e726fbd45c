"""A limb with play leaves its side where the load turns, and meets the other one later."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.backlash import lies
from tests.testbed.sessions.rich import ELBOW

BACKLASH = BY_NAME["backlash"]
STEP = 0.001


@pytest.mark.parametrize("gap", [0.003, 0.1])
def test_a_limb_crosses_its_gap_as_fast_as_its_load_lets_it(gap: float) -> None:
    """The load grows evenly after it has turned: the gap is a sixth of its slope by time cubed."""
    slope, turns = 80.0, 1.0
    time = np.arange(3000) * STEP
    ahead = lies(-slope * (time - turns), gap, STEP)
    landed = turns + (6.0 * gap / slope) ** (1 / 3)
    assert np.all(ahead[time < turns] == -0.5 * gap)
    assert np.all(ahead[time > landed + 2 * STEP] == 0.5 * gap)
    flown = (time > turns + 10 * STEP) & (time < landed - 2 * STEP)
    expected = slope * (time[flown] - turns) ** 3 / 6.0
    np.testing.assert_allclose(ahead[flown] + 0.5 * gap, expected, atol=0.05 * gap)


def test_a_limb_that_the_load_takes_back_in_time_lands_where_it_was() -> None:
    time = np.arange(2000) * STEP
    pull = np.where((time > 1.0) & (time < 1.02), -5.0, 5.0)
    ahead = lies(pull, 0.01, STEP)
    assert ahead.max() > -0.005 and ahead.max() < 0.005
    assert ahead[-1] == -0.005


def test_a_motor_with_play_carries_nothing_while_the_gap_is_crossed(recording: Recording) -> None:
    """The column takes the load away from where it turns until the limb lands."""
    joint, turns = unfitted(recording, ELBOW), 2.0
    carried = np.zeros_like(recording.position)
    carried[:, ELBOW] = load = -1.5 * (recording.time - turns)
    joint = replace(joint, estimate=replace(joint.estimate, carried=carried))
    theta = {"crossed": 0.4}
    (column,) = BACKLASH.columns(joint, theta)[ELBOW].T
    inertia = recording.inertia(ELBOW)[:, ELBOW].mean() - recording.motor_inertia(ELBOW)
    gap = BACKLASH.readings(joint, theta)["gap"].scale
    landed = turns + (6.0 * gap * inertia / 1.5) ** (1 / 3)
    flying = (recording.time > turns + 0.1) & (recording.time < landed - 0.1)
    assert flying.sum() > 20
    slope = recording.secant(ELBOW, 1e-4)[flying, ELBOW]
    lacks = column[flying] - slope * lies(load / inertia, gap, 1 / recording.rate)[flying]
    np.testing.assert_allclose(lacks, -load[flying], atol=0.1 * np.abs(load[flying]).max())


def test_a_gap_has_the_size_that_its_flights_say(recording: Recording) -> None:
    joint, theta = unfitted(recording, ELBOW), {"crossed": 0.1}
    assert not BACKLASH.beyond(joint, theta, {0: 1.2})
    assert BACKLASH.beyond(joint, theta, {0: 3.0}) == "gap"
    assert BACKLASH.beyond(joint, theta, {0: 0.2}) == "gap"


def test_at_a_limb_other_shares_of_its_inertia_are_tried_and_in_a_robot_all_of_it(
    recording: Recording,
) -> None:
    """Where the load changes sign depends on it: of three gaps of an opponent none was found."""
    limb, robot = (replace(recording, cache={}) for _ in range(2))
    limb.__dict__["limbs"], robot.__dict__["limbs"] = (ELBOW,), ()
    of_limb, of_robot = (BACKLASH.thetas(unfitted(one, ELBOW)) for one in (limb, robot))
    assert all(theta.keys() == {"crossed"} for theta in of_robot)
    assert {theta["inertia_behind"] for theta in of_limb} == {1.0, 0.6, 0.3, 0.15}
    assert len(of_limb) == 4 * len(of_robot)
