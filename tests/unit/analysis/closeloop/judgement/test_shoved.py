"""Who moves a resting joint away from there: its motor gives work, or takes it up."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.judgement.events import find_events
from analysis.closeloop.judgement.shoved import shoved_events
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.held import NOISE, RATE, TIME, bump, holding, with_effort
from tests.testbed.sessions.moved import moved


@pytest.mark.parametrize(
    ("against", "kept", "found"),
    [(-1.0, 0.0, 1), (-1.0, 0.65, 1), (-1.0, 1.0, 0), (1.0, 0.0, 0)],
    ids=["comes back", "friction keeps it", "slips", "its motor moves it"],
)
def test_a_push_below_the_effort_s_noise_shows_by_where_the_joint_goes(
    recording: Recording, against: float, kept: float, found: int
) -> None:
    """It goes away against its motor and comes some of the way back: nothing else does that."""
    rising = np.clip((TIME - 12.0) / 0.4, 0.0, 1.0)
    falling = np.clip((TIME - 12.6) / 0.4, 0.0, 1.0)
    way = 0.003 * (rising - (1.0 - kept) * falling)
    weak = 0.8 * NOISE * (rising - falling)
    still = replace(holding(recording, way, against * weak, sag=0.0), still=True)
    events = find_events(Model(still), still)
    assert len(events) == found
    assert all(11.9 < event.begin < 12.2 < 12.8 < event.end < 13.2 for event in events)


def test_a_joint_that_another_one_takes_along_is_not_pushed(recording: Recording) -> None:
    """The shoulder swings, and the elbow gives way now and then, its controller against it."""
    gives_way = bump(6.0, 1.5) + bump(12.0, 1.5)
    held = holding(recording, 0.003 * gives_way, -0.8 * NOISE * gives_way, sag=0.0)
    swing = 0.4 * np.sin(2 * np.pi * 0.7 * TIME)
    both = moved(held, np.column_stack([swing, held.position[:, 1]]), RATE)
    effort = both.static + both.filtered(np.column_stack([5.0 * np.gradient(swing, TIME)] * 2))
    effort[:, 1] = held.effort[:, 1]
    both = replace(both, session=held.session, effort=effort, joints=(0,), cache={})
    assert not [event for event in find_events(Model(both), both) if event.joint == 1]


def test_an_arm_that_sags_as_its_trial_begins_is_not_pushed(recording: Recording) -> None:
    sag = 0.003 * bump(0.05, 1.2)
    still = replace(holding(recording, sag, -0.8 * NOISE * bump(0.05, 1.2), sag=0.0), still=True)
    assert find_events(Model(still), still) == ()


#: Within a fifth of a second a joint goes to another place, and stays.
GONE = np.clip((TIME - 12.0) / 0.2, 0.0, 1.0)
SLID = 3.0 * GONE**2 - 2.0 * GONE**3
#: A torque that grows until friction gives way, and what is left of it then.
GROWN = np.clip((TIME - 10.0) / 2.0, 0.0, 1.0) - 0.6 * GONE
#: Its motor against a push, and against the friction that keeps it afterwards.
AGAINST = 0.5 * np.clip((TIME - 12.2) / 0.2, 0.0, 1.0) - 0.8 * GONE


@pytest.mark.parametrize(
    ("beyond", "found"),
    [
        (AGAINST, 1),
        (0.8 * GROWN, 0),
        (0.8 * GROWN - 1.5, 0),
        (-0.5 * NOISE * GONE, 0),
    ],
    ids=["pushed", "slips", "slips beside a wrong gravity", "less than the effort's noise"],
)
def test_a_joint_that_friction_keeps_where_it_went_is_pushed_if_its_motor_took_up_work(
    recording: Recording, beyond: np.ndarray, found: int
) -> None:
    held = holding(recording, 0.03 * SLID, beyond, sag=0.0)
    events = list(shoved_events(held, 1, None, [0]))
    assert len(events) == found
    assert all(11.9 < event.begin < event.end < 12.3 for event in events)


def test_a_joint_that_others_set_going_is_not_said_to_be_pushed(recording: Recording) -> None:
    """Their reaction moves it too, and nothing tells one from the other."""
    held = holding(recording, 0.03 * SLID, AGAINST, sag=0.0)
    swing = 0.4 * np.sin(2 * np.pi * 0.7 * TIME)
    beside = moved(held, np.column_stack([swing, held.position[:, 1]]), RATE)
    beside = replace(beside, session=held.session, effort=held.effort, cache={})
    assert list(shoved_events(beside, 1, None, [0])) == []
    assert len(list(shoved_events(held, 1, None, [0]))) == 1


@pytest.mark.parametrize("pushes", [1.0, -1.0])
def test_a_pushed_joint_that_its_motor_brings_back_against_friction_is_no_driven_one(
    recording: Recording, pushes: float
) -> None:
    """It gives more work on the way back than it took up on the way out."""
    away = 0.03 * bump(12.0, 1.6)
    out = TIME < 12.8
    torque = -pushes * np.where(out, 0.3, 1.0) * bump(12.0, 1.6)
    held = holding(recording, away, torque, sag=0.0)
    found = find_events(Model(held), with_effort(held, held.static[:, 1] + torque))
    assert len(found) == (pushes > 0.0)
    assert all(11.9 < event.begin < 12.8 < event.end < 13.7 for event in found)
