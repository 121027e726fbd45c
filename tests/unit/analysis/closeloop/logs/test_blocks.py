"""Which columns of a log without words are accelerations, and which are torques."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.blocks import of_either
from analysis.closeloop.logs.inspection import believe

JOINTS = 3
TIME = np.arange(0.0, 16.0, 0.01)
RATES = 1.0 + 0.7 * np.arange(JOINTS)
PHASE = np.outer(TIME, RATES) + np.arange(JOINTS)
POSITION = np.sin(PHASE) + 0.1 * np.sin(5.3 * PHASE)
VELOCITY = RATES * (np.cos(PHASE) + 0.53 * np.cos(5.3 * PHASE))
ACCELERATION = RATES**2 * (-np.sin(PHASE) - 2.809 * np.sin(5.3 * PHASE))
#: As an iiwa's: a filter has left less than half, and noise.
FILTERED = 0.4 * ACCELERATION + np.random.default_rng(0).normal(0.0, 0.7, PHASE.shape)
#: Of gravity and friction, at another scale at each joint.
TORQUE = np.array([30.0, 9.0, 1.0]) * (np.cos(POSITION) + 0.1 * np.sign(VELOCITY))


def believed(*blocks: np.ndarray) -> list[Belief]:
    """Return beliefs of a clock, positions, velocities and other blocks, without names."""
    table = np.column_stack([TIME, POSITION, VELOCITY, *blocks])
    names = [f"column {n + 1}" for n in range(table.shape[1])]
    return believe(log_of("CSV", zip(names, table.T, strict=True)))


def quantities(beliefs: Sequence[Belief]) -> list[str]:
    """Return what is after the velocities, once for each block."""
    return [belief.quantity for belief in beliefs[1 + 2 * JOINTS :: JOINTS]]


def test_torques_behind_accelerations_are_efforts() -> None:
    """A stranger's were unknown, where inspect had found the accelerations."""
    found = believed(ACCELERATION, TORQUE)
    assert quantities(found) == ["acceleration", "effort"]
    assert [b.joint for b in found[1 + 3 * JOINTS :]] == [0, 1, 2]


@pytest.mark.parametrize("swapped", [False, True])
def test_filtered_accelerations_are_no_efforts_of_an_arm(swapped: bool) -> None:
    """A stranger's iiwa was identified with its accelerations for torques."""
    blocks, found = [FILTERED, TORQUE], ["acceleration", "effort"]
    if swapped:
        blocks, found = blocks[::-1], found[::-1]
    assert quantities(believed(*blocks)) == found


def test_of_two_blocks_that_could_be_either_none_is_taken_and_it_is_said() -> None:
    inertias = np.array([30.0, 9.0, 1.0]) * FILTERED
    beliefs = believed(FILTERED, gaussian_filter1d(inertias, 2.0, axis=0))
    assert quantities(beliefs) == ["unknown", "unknown"]
    (said,) = of_either(beliefs)
    assert "--as 'column 8=JOINT.effort' or --as 'column 11=JOINT.effort'" in said


def test_of_two_blocks_of_which_none_is_like_a_slope_the_first_is_the_efforts() -> None:
    beliefs = believed(TORQUE, 20.0 + np.cos(0.1 * TIME[:, None] + np.arange(JOINTS)))
    assert quantities(beliefs) == ["effort", "unknown"] and of_either(beliefs) == []
