"""When a gain on rows that nothing was fitted to is no luck."""

import numpy as np

from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.selection import ALONE_Z, more_than_luck
from analysis.closeloop.session.recording import Recording


def test_a_gain_that_every_second_shows_is_no_luck_from_six_seconds_on() -> None:
    folds = np.arange(6) % 3
    assert more_than_luck(np.full(6, 2.0), np.linspace(0.9, 1.1, 6), folds)
    assert not more_than_luck(np.full(5, 2.0), np.linspace(0.9, 1.1, 5), folds[:5])


def test_trials_without_motion_have_no_rows(recording: Recording) -> None:
    rows = select_rows(recording, ())
    assert not len(rows.weight) and not any(len(own) for own in rows.samples.values())
    assert rows.parts.keys() == set(recording.joints)


def test_one_effect_alone_needs_less_than_the_best_of_many() -> None:
    """A fast second holds nearly all of what every second shows."""
    worse = np.array([100.0, *np.ones(13)])
    folds = np.arange(14) % 4
    assert more_than_luck(worse, 0.3 * worse, folds, ALONE_Z)
    assert not more_than_luck(worse, 0.3 * worse, folds)
    assert not more_than_luck(worse[:10], 0.3 * worse[:10], folds[:10], ALONE_Z)
