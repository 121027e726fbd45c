"""A trial that needs gravity is not asked for where there is none."""

from pathlib import Path

import pytest

from analysis.closeloop.load import load_session
from analysis.closeloop.report.separating import separating_trial
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.effects import GRAVITY
from tests.testbed.sessions.small import Folder

DOWN = f"0 0 -{GRAVITY}"


@pytest.mark.parametrize(
    ("gravity", "asked"),
    [(DOWN, "hold a known mass still"), (f"0 -{GRAVITY} 0", "pull level over a pulley")],
)
def test_a_gain_is_told_by_a_known_weight_that_the_joint_feels(
    tmp_path: Path, gravity: str, asked: str
) -> None:
    folder = Folder(tmp_path)
    folder.model = folder.model.replace(DOWN, gravity)
    recording = load_session(folder.write())
    (elbow,) = recording.joints
    assert asked in separating_trial(recording, elbow, BY_NAME["torque_gain"])
