"""What is left without a name: where a trial stands out, and what of it friction may be."""

import numpy as np

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.report.unexplained import _in_motion, _where
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW


def error(recording: Recording, samples: slice, size: float = 1.0) -> TrialError:
    time = recording.time[samples]
    left = np.full(len(time), size)
    return TrialError(trial=0, joint=ELBOW, time=time, effort=left, predicted=np.zeros(len(time)))


def test_a_joint_that_hardly_moves_in_a_trial_still_has_a_place_there(recording: Recording) -> None:
    """Of a UR10e that somebody pushes 20 samples at 125 Hz were in motion, and it was an error."""
    short = error(recording, slice(100, 120))
    place = _where(recording, short, 0.1)
    assert place["file"] == "a.csv" and place["rms"] == 1.0
    assert place["time"] == [short.time[0], short.time[-1]]


def test_where_a_joint_turns_its_friction_has_any_value(recording: Recording) -> None:
    moving = _in_motion(recording, error(recording, slice(0, 1000)))
    turning = recording.turning(ELBOW)
    assert 0 < len(moving.time) < 1000
    assert np.array_equal(moving.time, recording.time[~turning])
