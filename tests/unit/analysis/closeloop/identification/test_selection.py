"""When a gain on rows that nothing was fitted to is no luck."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.balance.luck import ALONE_Z, more_than_luck
from analysis.closeloop.identification.balance.regression import Rows, Score, select_rows
from analysis.closeloop.identification.findings import Option
from analysis.closeloop.identification.selection import MIN_TORQUE, _worth
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW


def test_a_gain_that_every_second_shows_is_no_luck_from_six_seconds_on() -> None:
    folds = np.arange(6) % 3
    assert more_than_luck(np.full(6, 2.0), np.linspace(0.9, 1.1, 6), folds)
    assert not more_than_luck(np.full(5, 2.0), np.linspace(0.9, 1.1, 5), folds[:5])


def test_trials_without_motion_have_no_rows(recording: Recording) -> None:
    rows = select_rows(recording, ())
    assert not len(rows.weight) and not any(len(own) for own in rows.samples.values())
    assert rows.parts.keys() == set(recording.joints)
    assert not len(rows.reweighted({}).weight) and not rows.joints


def test_one_effect_alone_needs_less_than_the_best_of_many() -> None:
    """A fast second holds nearly all of what every second shows."""
    worse = np.array([100.0, *np.ones(13)])
    folds = np.arange(14) % 4
    assert more_than_luck(worse, 0.3 * worse, folds, ALONE_Z)
    assert not more_than_luck(worse, 0.3 * worse, folds)
    assert not more_than_luck(worse[:10], 0.3 * worse[:10], folds[:10], ALONE_Z)


@pytest.mark.parametrize(
    ("takes", "smoothing", "worth"),
    [(0.95, 2.0, True), (0.95, 20.0, False), (0.7, 2.0, False)],
    ids=["nearly all", "no more than smoothing does", "a part"],
)
def test_little_torque_counts_if_it_takes_nearly_all_that_smoothing_does_not(
    takes: float, smoothing: float, worth: bool
) -> None:
    """Of a hundredth of what otherwise matters: backlash gives little torque, in its own form."""
    losses = np.linspace(0.5, 1.5, 12)
    rows = SimpleNamespace(
        effort_power=lambda joint: 1000.0 / MIN_TORQUE**2,
        smoothing_power=lambda joint: smoothing,
        fold_of_block=np.arange(12) % 3,
    )
    score = SimpleNamespace(losses=(1.0 - takes) * losses)
    option = SimpleNamespace(
        gain=takes * losses.sum(), candidate=SimpleNamespace(joint=0), score=score
    )
    current = cast(Score, SimpleNamespace(losses=losses))
    assert _worth(cast(Option, option), current, cast(Rows, rows), 0.0) is worth


def test_smoothing_takes_more_of_a_quick_motion(recording: Recording) -> None:
    slow = select_rows(replace(recording, joints=(ELBOW,), cache={}), (0,))
    sampling = replace(recording.sampling, cutoff=0.2 * recording.sampling.cutoff)
    smoother = replace(recording, joints=(ELBOW,), sampling=sampling, cache={})
    # The same samples, as if a lower cutoff had been needed.
    coarse = replace(slow, recording=smoother, stacked={})
    assert 0.0 < 20.0 * slow.smoothing_power(ELBOW) < coarse.smoothing_power(ELBOW)
