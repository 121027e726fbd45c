"""What friction does where a joint hardly moves is judged on rests that it was not fitted to."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from analysis.closeloop.identification.balance.accuracy import (
    _best,
    _share,
    raw_errors,
    settled,
)
from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.session.contents import Trial
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW, rich_elbow

TRIALS = np.repeat([0, 1], 100)


HELD = np.where(np.arange(200) % 50 < 25, 2.0, -2.0)
ALL = np.ones(200, dtype=bool)


def noisy(torque: np.ndarray) -> np.ndarray:
    return np.asarray(torque + 0.05 * np.random.default_rng(1).standard_normal(200))


def test_a_joint_that_stays_clamped_keeps_what_it_stopped_with() -> None:
    missing = noisy(0.6 * HELD)
    assert 0.55 < _share(HELD, missing) < 0.65
    for trial in (TRIALS, np.zeros(200, dtype=int)):
        assert _best([HELD], 0.1 * HELD, missing, ALL, trial) is HELD


def test_a_joint_that_creeps_through_a_reversal_rubs_the_other_way_at_its_end() -> None:
    held = np.full(200, 2.0)
    sliding = np.tile(np.linspace(2.0, -2.0, 25), 8)
    assert _best([held], sliding, noisy(sliding), ALL, TRIALS) is None


def test_a_joint_that_is_back_by_more_than_friction_gives_way_rubs_the_other_way() -> None:
    """Its speed says nothing: it stopped, and creeps back more slowly than a rest."""
    wound = np.where(np.arange(200) % 25 < 5, HELD, -HELD)
    assert _best([HELD, wound], 0.1 * HELD, noisy(wound), ALL, TRIALS) is wound
    assert _best([HELD, wound], 0.1 * HELD, noisy(HELD), ALL, TRIALS) is HELD


def test_a_share_that_one_trial_shows_and_the_other_does_not_is_no_law() -> None:
    """The second trial's rests are short: friction went on there, and the first says nothing."""
    held = np.full(200, 2.0)
    sliding = np.where(TRIALS == 0, 1.0, 0.0)
    missing = np.where(TRIALS == 0, 2.0, 0.0)
    assert _best([held], sliding, missing, ALL, TRIALS) is None


def test_a_joint_that_creeps_back_after_it_stopped_is_predicted() -> None:
    """At a speed that counts as rest, for seconds, as behind a controller that gives way."""
    seconds, rate, friction = 40, 50.0, 2.0
    time = np.arange(int(seconds * rate)) / rate
    # To one side in a second, 0.02 rad back in three, and to the other side, and so on.
    stroke = np.interp(time % 8.0, [0.0, 1.0, 4.0, 5.0, 8.0], [0.0, 1.0, 0.98, -0.02, 0.0])
    elbow = gaussian_filter1d(1.0 + stroke, 3.0)
    creeps = moved(rich_elbow(), np.column_stack([np.zeros(len(time)), elbow]), rate)
    assert creeps.resting(ELBOW, slice(0, len(time))).mean() > 0.6
    effort = np.full_like(creeps.position, np.nan)
    creeps = replace(creeps, effort=effort, cache={})
    coulomb, joint = BY_NAME["coulomb_friction"], unfitted(creeps, ELBOW)
    effort[:, ELBOW] = creeps.inverse[:, ELBOW] + friction * joint.wound(0.002)
    theta = {"smooth": 0.02}
    term = Term(
        joint=ELBOW,
        columns=coulomb.columns(joint, theta),
        lower=coulomb.lower,
        kept=(0,),
        theta=theta,
        effect=coulomb,
        candidate=Candidate(effect=coulomb, joint=ELBOW),
    )
    expected = settled(Model(creeps, terms=(term,)), np.array([friction]))
    left = (effort - expected)[creeps.resting(ELBOW, slice(0, len(time))), ELBOW]
    assert np.sqrt(np.mean(left**2)) < 0.3 * friction


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


def test_errors_are_those_between_the_ends_of_stretches_that_filters_touch() -> None:
    elbow = rich_elbow()
    trial = Trial(
        file="a.csv",
        label="a",
        group="a",
        role="fit",
        time=elbow.time,
        columns={"elbow.effort": np.zeros(len(elbow.time))},
    )
    session = replace(elbow.session, trials=(trial,))
    cut = replace(elbow, session=session, slices=[slice(0, 15), slice(15, 1000)], cache={})
    assert 2 * cut.edge > 15
    (error,) = raw_errors(cut, elbow.position, (0,))
    assert error.time[0] == elbow.time[15 + cut.edge]
    assert error.time[-1] == elbow.time[-cut.edge]
    short = replace(cut, slices=[slice(0, 15)], cache={})
    (error,) = raw_errors(short, elbow.position, (0,))
    assert error.time[0] == elbow.time[0], "a trial with nothing longer is compared whole"
    assert len(error.time) >= 15
