"""What friction does where a joint hardly moves is judged on rests that it was not fitted to."""

import numpy as np

from analysis.closeloop.identification.balance.accuracy import _creeps, _share

TRIALS = np.repeat([0, 1], 100)


def test_a_joint_that_stays_clamped_keeps_what_it_stopped_with() -> None:
    held = np.where(np.arange(200) % 50 < 25, 2.0, -2.0)
    missing = 0.6 * held + 0.05 * np.random.default_rng(1).standard_normal(200)
    assert 0.55 < _share(held, missing) < 0.65
    assert not _creeps(held, 0.1 * held, missing, TRIALS)
    assert not _creeps(held, 0.1 * held, missing, np.zeros(200, dtype=int))


def test_a_joint_that_creeps_through_a_reversal_rubs_the_other_way_at_its_end() -> None:
    held = np.full(200, 2.0)
    sliding = np.tile(np.linspace(2.0, -2.0, 25), 8)
    missing = sliding + 0.05 * np.random.default_rng(1).standard_normal(200)
    assert _creeps(held, sliding, missing, TRIALS)


def test_a_share_that_one_trial_shows_and_the_other_does_not_is_no_law() -> None:
    """The second trial's rests are short: friction went on there, and the first says nothing."""
    held = np.full(200, 2.0)
    sliding = np.where(TRIALS == 0, 1.0, 0.0)
    missing = np.where(TRIALS == 0, 2.0, 0.0)
    assert _creeps(held, sliding, missing, TRIALS)
