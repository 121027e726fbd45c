"""Where a joint sticks its friction is unknown: those rows say nothing."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.sticking import (
    friction_of,
    sliding,
    sticking,
    unknown_friction,
)
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW

FRICTION, NOISE, RATE = 2.0, 0.05, 50.0
TIME = np.arange(3000) / RATE


def rubbing(recording: Recording, cycles_hz: float = 0.2) -> Recording:
    """Return the elbow to and fro with Coulomb friction, its shoulder held."""
    return with_friction(recording, 1.0 + 0.5 * np.sin(2 * np.pi * cycles_hz * TIME))


def with_friction(recording: Recording, elbow: np.ndarray) -> Recording:
    """Return the elbow on a path, rad, with Coulomb friction, its shoulder held."""
    plain = moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)
    effort = np.full_like(plain.position, np.nan)
    effort[:, ELBOW] = plain.inverse[:, ELBOW] + FRICTION * np.sign(plain.velocity[:, ELBOW])
    return replace(plain, effort=plain.filtered(effort), cache={})


def rows_of(recording: Recording, noise: float, left: float) -> tuple[Rows, Rows]:
    """Return all rows, and those that stay: `left` where friction sticks, `noise` elsewhere, Nm."""
    rows = select_rows(recording, recording.fit_trials)
    sticks = FRICTION * sticking(recording, ELBOW)[rows.samples[ELBOW]] > noise
    return rows, sliding(Model(recording), rows, np.where(sticks, left, noise))


def test_where_a_joint_hardly_turns_the_rows_in_which_it_does_stay(recording: Recording) -> None:
    """Its friction is an offset without them. (An opponent's UR10: four times the error.)"""
    one_way = np.where(np.abs(TIME % 20.0 - 10.0) < 0.2, -0.05, 0.02)
    velocity = np.where(TIME < 50.0, one_way, 0.3 * np.sin(2 * np.pi * 0.2 * TIME))
    seldom = with_friction(recording, 0.8 + np.cumsum(velocity) / RATE)
    rows, kept = rows_of(seldom, NOISE, FRICTION)
    assert len(kept.weight) == len(rows.weight)
    often = rubbing(recording)
    rows, kept = rows_of(often, NOISE, FRICTION)
    assert len(kept.weight) < 0.9 * len(rows.weight)


def test_friction_is_half_of_the_step_where_a_joint_turns(recording: Recording) -> None:
    slow = rubbing(recording)
    rows = select_rows(slow, slow.fit_trials)
    assert friction_of(Model(slow), rows, ELBOW) == pytest.approx(FRICTION, rel=0.1)


def test_friction_is_at_least_what_the_model_says_of_it(recording: Recording) -> None:
    """The step where a joint turns is smoothed away or short, and what was found is known."""
    quick = rubbing(recording, cycles_hz=1.5)
    rows = select_rows(quick, quick.fit_trials)
    assert friction_of(Model(quick), rows, ELBOW) < 0.5 * FRICTION
    coulomb, joint = BY_NAME["coulomb_friction"], unfitted(quick, ELBOW)
    columns = coulomb.columns(joint, {"smooth": 0.02})
    term = Term(effect=coulomb, joint=ELBOW, columns=columns, theta={"smooth": 0.02}, kept=(0,))
    found = friction_of(Model(quick, terms=(term,)), rows, ELBOW)
    assert found == pytest.approx(FRICTION, rel=0.1)


def test_a_reversal_is_felt_as_long_as_the_low_pass_rings(recording: Recording) -> None:
    slow = rubbing(recording)
    reach = sticking(slow, ELBOW)
    turn = int(np.argmin(np.abs(TIME - 1.25)))
    period = round(slow.rate / slow.sampling.fit_cutoff)
    assert 0.3 < reach[turn] < 1.3
    assert reach[turn + 6 * period] < 1e-3 < reach[turn + 2 * period]


def test_an_effort_that_is_early_has_unknown_friction_early(recording: Recording) -> None:
    """Behind a delay the effort of a reversal comes before it: four sticks were told as pushes."""
    slow, delay = rubbing(recording), 0.2
    late = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    rows = select_rows(slow, slow.fit_trials)
    plain, early = (
        unknown_friction(model, rows, ELBOW)
        for model in (
            Model(slow),
            Model(slow, channels=(Channel(candidate=late, theta={"delay": delay}),)),
        )
    )
    steps = round(delay * RATE)
    shared = slice(steps, len(TIME) - 2 * steps)
    moved_on = np.roll(plain, -steps)[shared] * early.max() / plain.max()
    np.testing.assert_allclose(early[shared], moved_on, atol=0.02 * early.max())


def test_rows_around_reversals_go_where_many_times_the_noise_is_left(
    recording: Recording,
) -> None:
    rows, kept = rows_of(rubbing(recording), NOISE, 10.0 * NOISE)
    speed = np.abs(kept.recording.velocity[kept.samples[ELBOW], ELBOW])
    assert 0.5 < len(kept.weight) / len(rows.weight) < 0.95
    assert speed.min() > 0.05 * np.abs(rows.recording.velocity[:, ELBOW]).max()
    assert set(np.unique(kept.block)) == set(range(int(kept.block.max()) + 1))


def test_rows_around_reversals_stay_where_little_more_is_left(recording: Recording) -> None:
    rows, kept = rows_of(rubbing(recording), NOISE, 2.0 * NOISE)
    assert len(kept.weight) == len(rows.weight)


def test_every_row_stays_where_friction_is_less_than_the_noise(recording: Recording) -> None:
    rows, kept = rows_of(rubbing(recording), 3.0 * FRICTION, 30.0 * FRICTION)
    assert len(kept.weight) == len(rows.weight)


def test_of_a_joint_that_turns_all_the_time_half_of_the_rows_stay(recording: Recording) -> None:
    quick = rubbing(recording, 2.0)
    rows = select_rows(quick, quick.fit_trials)
    least = np.quantile(sticking(quick, ELBOW)[rows.samples[ELBOW]], 0.5)
    sticks = sticking(quick, ELBOW)[rows.samples[ELBOW]] > least
    kept = sliding(Model(quick), rows, np.where(sticks, 1e-5, 1e-6))
    assert len(kept.weight) == pytest.approx(0.5 * len(rows.weight), rel=0.02)
