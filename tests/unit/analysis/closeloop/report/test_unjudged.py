"""Of an error far above its floor it is said where it is, though it is not judged there."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Errors, Floor, Outcome
from analysis.closeloop.report.unexplained import OF_FLOOR
from analysis.closeloop.report.unjudged import OF_ALL, beyond_floor, shares, where_unjudged
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW


def error(recording: Recording, residual: np.ndarray) -> TrialError:
    return TrialError(
        trial=0,
        joint=ELBOW,
        time=recording.time,
        effort=residual,
        predicted=np.zeros(len(residual)),
    )


def outcome(recording: Recording, residual: np.ndarray) -> Outcome:
    """An outcome with a held-out error and a floor of 0.06 Nm."""
    left = error(recording, residual)
    return cast(
        Outcome,
        SimpleNamespace(
            holdout=Errors(before=[left], after=[left]),
            floors={ELBOW: Floor(value=0.06, source="repeats")},
            trace=SimpleNamespace(rows=SimpleNamespace(recording=recording)),
        ),
    )


@pytest.mark.parametrize(
    ("size", "floor", "square"),
    [(0.30, 0.06, 0.30**2 - 0.06**2), (0.11, 0.06, 0.0), (0.30, None, 0.0)],
)
def test_an_error_counts_from_twice_its_floor_on_and_only_beside_one(
    recording: Recording, size: float, floor: float | None, square: float
) -> None:
    found = None if floor is None else Floor(value=floor, source="repeats")
    left = error(recording, np.full(len(recording.time), size))
    assert beyond_floor([left], found) == pytest.approx(square)
    # A joint that only turns has no sample in motion.
    assert beyond_floor([], found) == 0.0


def test_where_the_power_is_is_told_at_turns_and_above_the_band(recording: Recording) -> None:
    """0.30 Nm, 5.5 times the floor, where a joint turned, and not a word: 84 % of the power."""
    turning = recording.turning(ELBOW)
    at_turns = np.where(turning, 0.5, 0.0)
    turns, fast = shares(recording, [error(recording, at_turns)])
    assert turns == 1.0 and fast < 0.2
    noise = np.random.default_rng(3).standard_normal(len(turning))
    turns, fast = shares(recording, [error(recording, np.where(turning, 0.0, noise))])
    assert turns == 0.0 and fast > 0.8
    slow = np.sin(0.5 * recording.time)
    turns, fast = shares(recording, [error(recording, np.where(turning, 0.0, slow))])
    assert turns == 0.0 and fast < 0.1


def test_where_an_error_is_far_above_its_floor_is_said_unless_unexplained_does(
    recording: Recording,
) -> None:
    found = outcome(recording, np.full(len(recording.time), 0.30))
    (line,) = where_unjudged(found, {})
    assert line.startswith("elbow: its error after, 0.3 Nm, is 5.0 times the noise of its effort")
    assert "% of its power is where the joint rests or turns around" in line
    assert where_unjudged(found, {"elbow": {"rms_of": OF_ALL}}) == [line]
    assert where_unjudged(found, {"elbow": {"rms_of": OF_FLOOR}}) == []
    assert where_unjudged(outcome(recording, np.full(len(recording.time), 0.11)), {}) == []


def test_an_error_at_turns_is_said_whatever_else_is_unexplained(recording: Recording) -> None:
    """A KR 300: 98 Nm, 38 of them in `unexplained`; 82 % of the power was where it turned."""
    turning = recording.turning(ELBOW)
    found = outcome(recording, np.where(turning, 3.0, 0.1))
    (line,) = where_unjudged(found, {"elbow": {"rms_of": OF_FLOOR}})
    power = np.where(turning, 9.0, 0.01)
    share = power[turning].sum() / power.sum()
    assert share > 0.8 and f"{100 * share:.0f} % of its power is where the joint rests" in line


def test_a_trial_of_which_no_sample_is_left_has_no_share(recording: Recording) -> None:
    """A trial of 0.6 s ended in a traceback."""
    gone = replace(error(recording, np.full(len(recording.time), 0.5)), trial=99)
    assert shares(recording, [gone]) == (0.0, 0.0)
