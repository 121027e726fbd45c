"""What friction does where a joint hardly moves is judged on rests that it was not fitted to."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.accuracy import _creeps, _share, settled
from analysis.closeloop.identification.balance.model import Candidate, Model, Term, unfitted
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow

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


def test_rests_of_a_trial_without_the_joints_effort_say_nothing_of_friction() -> None:
    elbow = rich_elbow()
    velocity = np.array(elbow.velocity)
    velocity[400:500] = velocity[900:] = 0.0
    effort = np.array(elbow.effort)
    effort[:500] = np.nan
    trial = elbow.session.trials[0]
    recording = replace(
        elbow,
        session=replace(elbow.session, trials=(trial, replace(trial, label="b", group="b"))),
        slices=[slice(0, 500), slice(500, 1000)],
        trial=np.repeat([0, 1], 500),
        velocity=velocity,
        effort=effort,
        fit_trials=(0, 1),
        cache={},
    )
    coulomb = BY_NAME["coulomb_friction"]
    columns = coulomb.columns(unfitted(recording, ELBOW), {"smooth": 0.02})
    term = Term(
        joint=ELBOW,
        columns=columns,
        lower=coulomb.lower,
        kept=(0,),
        theta={"smooth": 0.02},
        effect=coulomb,
        candidate=Candidate(effect=coulomb, joint=ELBOW),
    )
    expected = settled(Model(recording, terms=(term,)), np.array([1.0]))
    assert np.isfinite(expected[:, ELBOW]).all()
