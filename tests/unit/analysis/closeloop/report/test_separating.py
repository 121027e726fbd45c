"""A trial that needs gravity is not asked for where there is none, nor an untouched limb."""

from pathlib import Path

import pytest

from analysis.closeloop.identification.findings import Event
from analysis.closeloop.load import load_session
from analysis.closeloop.report.separating import separating_trial
from analysis.closeloop.report.unexplained import untouched
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.effects import GRAVITY
from tests.testbed.sessions.small import Folder

DOWN = f"0 0 -{GRAVITY}"


@pytest.mark.parametrize(
    ("gravity", "asked"),
    [(DOWN, "hold a known mass still"), (f"0 -{GRAVITY} 0", "pull horizontally over a pulley")],
)
def test_a_gain_is_told_by_a_known_weight_that_the_joint_feels(
    tmp_path: Path, gravity: str, asked: str
) -> None:
    folder = Folder(tmp_path)
    folder.model = folder.model.replace(DOWN, gravity)
    recording = load_session(folder.write())
    (elbow,) = recording.joints
    assert asked in separating_trial(recording, elbow, BY_NAME["torque_gain"])


@pytest.mark.parametrize(
    ("limb", "asked"),
    [(True, "the limb relaxed, and nothing"), (False, "nothing and nobody touching")],
)
def test_a_trial_with_a_limb_is_not_to_be_repeated_without_it(
    tmp_path: Path, limb: bool, asked: str
) -> None:
    folder = Folder(tmp_path)
    folder.session["limb_joints"] = ["elbow"] if limb else []
    recording = load_session(folder.write())
    (line,) = untouched(recording, [Event(trial=0, joint=1, begin=1.0, end=1.5, peak=0.4)])
    assert f"Repeat a.csv with {asked}" in line
