"""Effort or positions in another unit are one error; a poor model and a heavy load are none."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.units import doubtful_units
from tests.testbed.sessions.effects import GRAVITY
from tests.testbed.sessions.small import ARM, Folder

EFFORT = 4


def moved(path: Path) -> Folder:
    """Return a session whose effort is not only that of the declared arm, but a little noisy."""
    folder = Folder(path)
    folder.table = folder.table.copy()
    random = np.random.default_rng(3)
    folder.table[:, EFFORT] += 0.02 * random.standard_normal(len(folder.table))
    return folder


@pytest.mark.parametrize(
    ("constant", "said"),
    [
        (1000.0, "is its unit mNm"),
        (100.0, "is its unit N cm"),
        (10.2, "is its unit kgf cm"),
        (8.85, "is its unit lb in"),
        (50.0, "what is its unit"),
        (0.2, "before a gear of 1:5"),
        (0.02, "before a gear of 1:50"),
    ],
)
def test_an_effort_in_another_unit_is_an_error_that_says_which(
    tmp_path: Path, constant: float, said: str
) -> None:
    folder = moved(tmp_path)
    folder.table[:, EFFORT] *= constant
    with pytest.raises(SessionError, match=said) as caught:
        load_session(folder.write())
    assert caught.value.column == "elbow.effort"


@pytest.mark.parametrize("constant", [0.4, 0.7376, 1.0, 2.5])
def test_a_gain_that_can_be_found_is_no_error(tmp_path: Path, constant: float) -> None:
    folder = moved(tmp_path)
    folder.table[:, EFFORT] *= constant
    load_session(folder.write())


@pytest.mark.parametrize("times", [1.0, 8.0])
@pytest.mark.parametrize("distance", [0.1, 0.45])
def test_a_load_that_nobody_declared_is_no_error(
    tmp_path: Path, times: float, distance: float
) -> None:
    folder = moved(tmp_path)
    time, _, q = folder.table[:, :3].T
    acceleration = np.gradient(np.gradient(q, time), time)
    load = times * ARM.mass * distance
    folder.table[:, EFFORT] += load * (distance * acceleration + GRAVITY * np.cos(q - 0.4))
    load_session(folder.write())


@pytest.mark.parametrize("constant", [1.0, 2.5, 5.0])
def test_a_factor_that_may_be_masses_is_a_doubt(tmp_path: Path, constant: float) -> None:
    folder = moved(tmp_path)
    folder.table[:, EFFORT] *= constant
    said = doubtful_units(load_session(folder.write()))
    assert ["in gravity and inertia alike" in doubt for doubt in said] == [True] * (constant > 3.0)


def test_friction_that_nobody_declared_is_no_error(tmp_path: Path) -> None:
    folder = moved(tmp_path)
    folder.table[:, EFFORT] += 30.0 * np.tanh(folder.table[:, 3] / 0.05)
    load_session(folder.write())


def test_positions_in_turns_are_an_error(tmp_path: Path) -> None:
    folder = moved(tmp_path)
    folder.table[:, 1:4] /= 2.0 * np.pi
    with pytest.raises(SessionError, match="looks like turns") as caught:
        load_session(folder.write())
    assert caught.value.column == "elbow.position"


def weightless(path: Path) -> Folder:
    """Return the same session with the arm's axes upright: gravity has no torque."""
    folder = moved(path)
    folder.table[:, EFFORT] -= ARM.mass * GRAVITY * ARM.lever * np.cos(folder.table[:, 2] - 0.4)
    folder.model = folder.model.replace(f"0 0 -{GRAVITY}", f"0 -{GRAVITY} 0")
    return folder


@pytest.mark.parametrize(
    ("constant", "said"),
    [
        (1000.0, "is its unit mNm"),
        (141.6, "is its unit oz in"),
        (0.2, "before a gear of 1:5"),
        (0.001, "masses in g"),
    ],
)
def test_where_nothing_weighs_inertia_says_the_unit(
    tmp_path: Path, constant: float, said: str
) -> None:
    folder = weightless(tmp_path)
    folder.table[:, EFFORT] *= constant
    with pytest.raises(SessionError, match=said) as caught:
        load_session(folder.write())
    assert caught.value.column == "elbow.effort"


def test_where_nothing_weighs_an_inertia_that_nobody_declared_is_a_doubt_and_no_error(
    tmp_path: Path,
) -> None:
    folder = weightless(tmp_path)
    sound = load_session(folder.write())
    assert doubtful_units(sound) == []
    time, _, q = folder.table[:, :3].T
    acceleration = np.gradient(np.gradient(q, time), time)
    folder.table[:, EFFORT] += 9.0 * ARM.inertia * acceleration
    (doubt,) = doubtful_units(load_session(folder.write()))
    assert "needs 9.99 times the declared inertia" in doubt


def test_a_torque_that_no_limb_bears_is_an_error_where_nothing_says_the_unit(
    tmp_path: Path,
) -> None:
    folder = weightless(tmp_path)
    # Fifty times slower, and no noise: nothing is left that inertia could take.
    folder.table[:, 0] *= 50.0
    folder.table[:, 3] /= 50.0
    every = np.linspace(0.0, folder.table[-1, 0], 10 * len(folder.table))
    columns = [np.interp(every, folder.table[:, 0], column) for column in folder.table.T]
    folder.table = np.column_stack(columns)
    folder.table[:, EFFORT] = 1000.0 * ARM.stiffness * (folder.table[:, 2] - ARM.neutral)
    with pytest.raises(SessionError, match="no joint of a limb bears more than 1200") as caught:
        load_session(folder.write())
    assert caught.value.column == "elbow.effort"
