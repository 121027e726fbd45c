"""A push goes on across lost samples if it stands on both sides of them."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.events import find_events
from analysis.closeloop.judgement.gaps import sides_of
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.moved import moved

RATE, NOISE = 100.0, 0.02
TIME = np.arange(int(40.0 * RATE)) / RATE
#: Samples that are lost, s.
LOST, FOUND = 20.05, 20.2


def bump(begin: float, seconds: float) -> np.ndarray:
    """Return a smooth push of height 1, (n,)."""
    inside = (begin < TIME) & (begin + seconds > TIME)
    return np.where(inside, np.sin(np.pi * (TIME - begin) / seconds) ** 2, 0.0)


@pytest.fixture
def swinging(recording: Recording) -> Recording:
    """The elbow in motion, in the middle of a stroke where samples are lost."""
    phase = 2 * np.pi * 0.4 * (TIME - 20.1) + 0.6 * np.sin(0.31 * (TIME - 20.1))
    elbow = 1.0 + 0.5 * np.sin(phase)
    return moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)


def with_gap(recording: Recording, beyond: np.ndarray) -> Recording:
    """Return the recording with the model's own torque and more, but for samples that are lost.

    Where they are missing stands a line, as an interpolation puts there.
    """
    rng = np.random.default_rng(4)
    effort = np.full_like(recording.position, np.nan)
    effort[:, 1] = recording.inverse[:, 1] + NOISE * rng.standard_normal(len(TIME)) + beyond
    lost = (TIME > LOST) & (TIME < FOUND)
    effort[lost, 1] = np.interp(TIME[lost], TIME[~lost], effort[~lost, 1])
    unseen = (LOST - recording.edge / RATE < TIME) & (FOUND + recording.edge / RATE > TIME)
    gap = replace(recording, measured=np.where(unseen, 0.0, 1.0), unfiltered=effort, cache={})
    return replace(gap, effort=gap.filtered(effort))


def events(recording: Recording, beyond: np.ndarray) -> tuple[Event, ...]:
    found = with_gap(recording, beyond)
    return find_events(Model(found), found)


def test_a_push_in_which_samples_are_lost_is_one_push(swinging: Recording) -> None:
    """As long as no fit looks beside a gap: of an opponent's push of 0.6 s nothing was left."""
    (event,) = events(swinging, 0.8 * bump(19.8, 0.6))
    assert 19.6 < event.begin < 20.0 < 20.25 < event.end < 20.8
    assert event.peak == pytest.approx(0.8, rel=0.35)


def test_what_stands_on_one_side_of_lost_samples_is_no_push(swinging: Recording) -> None:
    """How the joint moved among them is a guess, which is felt on either side."""
    before = 0.8 * bump(19.8, 0.6) * (TIME < 20.1)
    assert events(swinging, before) == ()
    assert events(swinging, before - 0.8 * bump(19.8, 0.6) * (TIME > 20.1)) == ()


def test_less_than_the_motion_takes_beside_lost_samples_is_no_push(swinging: Recording) -> None:
    """A motion that starts or turns among them is wrong by all that it takes."""
    quick = np.array(swinging.acceleration)
    quick[:, 1] += 300.0 * np.sin(2 * np.pi * 1.3 * TIME)
    swinging = replace(swinging, acceleration=quick, cache={})
    assert events(swinging, 0.8 * bump(19.8, 0.6)) == ()


def test_a_gap_has_as_many_samples_at_its_sides_as_filters_reach(swinging: Recording) -> None:
    ((before, after),) = sides_of(with_gap(swinging, np.zeros(len(TIME))))
    assert TIME[before.stop] == pytest.approx(LOST + 1 / RATE, abs=1.1 / RATE)
    assert TIME[after.start] == pytest.approx(FOUND, abs=1.1 / RATE)
    assert before.stop - before.start == after.stop - after.start == swinging.edge
