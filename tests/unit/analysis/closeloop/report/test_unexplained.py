"""What is left without a name: where a trial stands out, and what of it friction may be."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Errors, Outcome
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.report.unexplained import (
    _band,
    _in_motion,
    _where,
    at_rest_where_worse,
    oscillating,
)
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


def test_the_few_samples_of_a_joint_that_is_mostly_held_have_no_band(recording: Recording) -> None:
    # Two or three samples of an arm, one joint of which is held in most trials: an IndexError.
    short = error(recording, slice(100, 102))
    alternating = replace(short, predicted=np.array([-1.0, 1.0]))
    assert _band(recording, [alternating], []) is None
    slow = replace(error(recording, slice(0, 1000)), predicted=np.sin(np.arange(1000) / 20.0))
    low, high = _band(recording, [slow], []) or (np.nan, np.nan)
    assert 0.0 <= low <= high < 0.5 * recording.sampling.recorded


def test_where_a_joint_turns_its_friction_has_any_value(recording: Recording) -> None:
    moving = _in_motion(recording, error(recording, slice(0, 1000)))
    turning = recording.turning(ELBOW)
    assert 0 < len(moving.time) < 1000
    assert np.array_equal(moving.time, recording.time[~turning])


def test_an_error_that_grows_where_a_joint_only_rests_says_nothing_of_a_repair(
    recording: Recording,
) -> None:
    """An opponent's joint with a cable: 0.06 Nm before, 0.46 Nm after, and not a word."""
    whole = slice(0, len(recording.time))
    small, large = (error(recording, whole, size) for size in (0.06, 0.46))
    still = replace(recording, position=np.full_like(recording.position, 0.3), cache={})
    (line,) = at_rest_where_worse(still, Errors(before=[small], after=[large]))
    assert "elbow: its error grows, 0.06 to 0.46 Nm" in line and "hold out a trial" in line
    assert at_rest_where_worse(still, Errors(before=[large], after=[small])) == []
    # What no reader could see.
    more = error(recording, whole, 0.06001)
    assert at_rest_where_worse(still, Errors(before=[small], after=[more])) == []
    assert at_rest_where_worse(recording, Errors(before=[small], after=[large])) == []


@pytest.mark.parametrize(("size", "said"), [(0.9, True), (0.5, False)])
def test_what_vibrates_is_to_be_looked_for_where_it_is_most_of_an_error(
    recording: Recording, size: float, said: bool
) -> None:
    """Who had a loose belt that rang at 7 Hz was told to record temperature."""
    outcome = SimpleNamespace(
        trace=SimpleNamespace(rows=SimpleNamespace(recording=recording)),
        oscillations={ELBOW: [Peak(low_hz=6.5, high_hz=8.0, rms=size)]},
        recorded=Errors(before=[], after=[error(recording, slice(0, 1000))]),
    )
    lines = oscillating(cast(Outcome, outcome))
    assert len(lines) == said
    assert all("of elbow oscillates at 6.5 to 8 Hz" in line for line in lines)
