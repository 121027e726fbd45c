"""What is noticed in a trial's signals is told beside their picture."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.load import load_session
from analysis.closeloop.report.preview import preview, remarks
from tests.testbed.sessions.small import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


def noticed(folder: Folder) -> str:
    recording = load_session(folder.write())
    return "; ".join(remarks(recording, 0))


def test_a_clean_trial_is_left_without_a_word(folder: Folder) -> None:
    assert noticed(folder) == ""


def test_a_gap_and_what_is_used_are_told(folder: Folder) -> None:
    folder.table = np.delete(folder.table, slice(800, 1000), axis=0)
    assert "has gaps: 2 stretches are used, of 9.0 s in all" in noticed(folder)


def test_a_jittered_clock_is_told(folder: Folder) -> None:
    rng = np.random.default_rng(3)
    folder.table[:, 0] += 0.0012 * rng.uniform(-1, 1, len(folder.table))
    assert "has a jittered clock: steps of 5" in noticed(folder)


def test_a_coarse_effort_is_told(folder: Folder) -> None:
    folder.table[:, 4] = np.round(folder.table[:, 4] / 0.2) * 0.2
    assert "coarse effort of elbow" in noticed(folder) and "0.2 Nm apart" in noticed(folder)


def test_a_trial_that_moves_one_way_and_rests_is_told(folder: Folder) -> None:
    t = folder.table[:, 0]
    way = np.clip((t - 1.0) / 3.0, 0.0, 1.0)
    way = way**2 * (3 - 2 * way)
    folder.table[:, 2] = 0.5 + way
    folder.table[:, 3] = np.gradient(folder.table[:, 2], t)
    folder.table[:, 4] = 2.0 * way + 0.3 * folder.table[:, 3] + 0.01 * np.sin(40 * t)
    assert "in one direction only" in noticed(folder) and "of the time at elbow" in noticed(folder)


def test_the_picture_shows_each_analysed_joints_position_velocity_and_effort(
    folder: Folder,
) -> None:
    recording = load_session(folder.write())
    axes = preview(recording, 0).axes
    assert [a.get_ylabel() for a in axes] == ["position, rad", "velocity, rad/s", "effort, Nm"]
    assert [a.get_xlabel() for a in axes] == ["time, s"] * 3
    assert axes[0].get_title(loc="left") == "elbow"
    assert all(len(a.lines) == 2 for a in axes)


def test_the_picture_says_which_line_was_recorded_and_which_is_analysed(folder: Folder) -> None:
    folder.table = np.delete(folder.table, slice(800, 1000), axis=0)
    legend = preview(load_session(folder.write()), 0).axes[-1].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["recorded", "analysed"]
