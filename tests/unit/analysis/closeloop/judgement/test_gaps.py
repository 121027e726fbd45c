"""What stands beside lost samples is a push if it is more than they leave elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.events import find_events
from analysis.closeloop.judgement.gaps import Gaps, gaps_of, sides_of, with_sides
from analysis.closeloop.judgement.holds import needed_by
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import derivatives
from tests.testbed.sessions.moved import moved

RATE, NOISE = 100.0, 0.02
TIME = np.arange(int(40.0 * RATE)) / RATE
#: Samples that are lost, s.
LOST, FOUND = 20.05, 20.2
PHASE = 2 * np.pi * 0.4 * (TIME - 20.1) + 0.6 * np.sin(0.31 * (TIME - 20.1))
#: An elbow in motion, in the middle of a stroke where samples are lost; and one that shakes as
#: quickly as no bridge over so many follows.
SWINGING = 1.0 + 0.5 * np.sin(PHASE)
SHAKING = SWINGING + 0.1 * np.sin(2 * np.pi * 3.0 * (TIME - 20.1) + 0.8)


def bump(begin: float, seconds: float) -> np.ndarray:
    """Return a smooth push of height 1, (n,)."""
    inside = (begin < TIME) & (begin + seconds > TIME)
    return np.where(inside, np.sin(np.pi * (TIME - begin) / seconds) ** 2, 0.0)


def with_gap(recording: Recording, elbow: np.ndarray, beyond: np.ndarray) -> Recording:
    """Return a recording of a motion and of its torque and more, but for samples that are lost.

    Where they are missing stands what bridges them, as in `stretches`.
    """
    whole = moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)
    rng = np.random.default_rng(4)
    effort = np.full_like(whole.position, np.nan)
    effort[:, 1] = whole.inverse[:, 1] + NOISE * rng.standard_normal(len(TIME)) + beyond
    lost = (TIME > LOST) & (TIME < FOUND)
    effort[lost, 1] = np.interp(TIME[lost], TIME[~lost], effort[~lost, 1])
    raw, known = TIME[~lost], elbow[~lost]
    bridged = CubicHermiteSpline(raw, known, np.gradient(known, raw))(TIME)
    motion = derivatives(np.column_stack([np.zeros(len(TIME)), bridged]), whole.sampling)
    columns = {f"{whole.name(1)}.position": known}
    trial = replace(whole.session.trials[0], time=raw, columns=columns)
    unseen = (LOST - whole.edge / RATE < TIME) & (FOUND + whole.edge / RATE > TIME)
    found = replace(
        whole,
        session=replace(whole.session, trials=(trial,)),
        position=motion[0],
        velocity=motion[1],
        acceleration=motion[2],
        measured=np.where(unseen, 0.0, 1.0),
        unfiltered=effort,
        cache={},
    )
    return replace(found, effort=found.filtered(effort))


def events(recording: Recording, elbow: np.ndarray, beyond: np.ndarray) -> tuple[Event, ...]:
    found = with_gap(recording, elbow, beyond)
    return find_events(Model(found), found)


def gaps(recording: Recording, elbow: np.ndarray, beyond: np.ndarray) -> Gaps:
    found = with_gap(recording, elbow, beyond)
    return gaps_of(Model(found), select_rows(found, (0,)))


def test_a_push_in_which_samples_are_lost_is_one_push(recording: Recording) -> None:
    """As long as no fit looks beside a gap: of an opponent's push of 0.6 s nothing was left."""
    (event,) = events(recording, SWINGING, 0.8 * bump(19.8, 0.6))
    assert 19.6 < event.begin < 20.0 < 20.25 < event.end < 20.8
    assert event.peak == pytest.approx(0.8, rel=0.35)


def test_a_push_that_ends_among_lost_samples_stands_on_one_side(recording: Recording) -> None:
    """An opponent's of 1.5 Nm ended in a gap of 0.24 s."""
    (event,) = events(recording, SWINGING, 0.8 * bump(19.8, 0.4))
    assert 19.5 < event.begin < 19.8 < 20.0 < event.end < 20.1
    assert event.peak == pytest.approx(0.8, rel=0.35)


def test_a_push_smaller_than_the_torque_of_the_motion_is_told(recording: Recording) -> None:
    """All of that had been excused beside a gap: more than two opponent's pushes of 1.9 Nm."""
    wide = 1.0 + 4.0 * (SWINGING - 1.0)
    push = 0.4 * bump(19.8, 0.6)
    found = with_gap(recording, wide, push)
    needed = needed_by(found, 1) - found.static[:, 1]
    assert np.abs(needed[1980:2050]).max() > np.abs(push).max()
    (event,) = events(recording, wide, push)
    assert 19.6 < event.begin < 20.0 < 20.25 < event.end < 20.8


def test_what_bridges_leave_elsewhere_too_is_no_push(recording: Recording) -> None:
    """How the joint moved among lost samples is a guess, which is felt on either side."""
    assert events(recording, SHAKING, np.zeros(len(TIME))) == ()
    quiet, shaken = (gaps(recording, own, np.zeros(len(TIME))) for own in (SWINGING, SHAKING))
    assert shaken.early[-1, 1] > 5.0 * quiet.early[-1, 1]


def test_what_is_quicker_than_the_low_pass_is_no_push_beside_lost_samples(
    recording: Recording,
) -> None:
    """It is held back less where the low-pass sees one side only. (An opponent's tremor.)"""
    quick = np.sin(2 * np.pi * 9.0 * TIME)
    assert events(recording, SWINGING, quick) == ()


def test_beside_lost_samples_nothing_is_told_where_too_few_places_say_what_they_leave(
    recording: Recording,
) -> None:
    found = with_gap(recording, SWINGING, 0.8 * bump(19.8, 0.6))
    measured = np.where(np.arange(len(TIME)) % 100 < 50, found.measured, 0.0)
    sparse = replace(found, measured=measured, cache={})
    assert gaps_of(Model(sparse), select_rows(sparse, (0,))).sides == ()


def test_no_row_among_lost_samples_tells_of_a_push(recording: Recording) -> None:
    found = with_gap(recording, SWINGING, np.zeros(len(TIME)))
    ((before, after),) = sides_of(found)
    seen = with_sides(found, ((before, after),)).usable
    assert seen[before].all()
    assert seen[after].all()
    assert not seen[before.stop : after.start].any()


def test_a_gap_has_as_many_samples_at_its_sides_as_filters_reach(recording: Recording) -> None:
    found = with_gap(recording, SWINGING, np.zeros(len(TIME)))
    ((before, after),) = sides_of(found)
    assert TIME[before.stop] == pytest.approx(LOST + 1 / RATE, abs=1.1 / RATE)
    assert TIME[after.start] == pytest.approx(FOUND, abs=1.1 / RATE)
    assert before.stop - before.start == after.stop - after.start == found.edge
