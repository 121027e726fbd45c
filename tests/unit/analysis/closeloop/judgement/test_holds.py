"""A push moves a joint that its controller holds; what its own motor moves is not pushed."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.events import find_events, spared
from analysis.closeloop.judgement.holds import rest_events
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import holds
from analysis.closeloop.session.signals import last_digit
from analysis.closeloop.signs import check_signs
from tests.testbed.sessions.held import NOISE, RATE, TIME, bump, holding, with_effort
from tests.testbed.sessions.moved import moved

FRICTION = 0.8  # Nm


def test_a_push_that_moves_a_held_joint_is_found_with_its_time(recording: Recording) -> None:
    pushed = holding(recording, 0.03 * bump(12.0, 0.8), -0.8 * bump(12.0, 0.8))
    (event,) = find_events(Model(pushed), pushed)
    assert 11.9 < event.begin < 12.3 < 12.5 < event.end < 12.9
    assert event.peak == pytest.approx(-0.8, rel=0.25)


def in_a_narrow_band(recording: Recording) -> Recording:
    """Return the recording with a fit that only goes up to 2 Hz."""
    narrow = replace(recording, sampling=replace(recording.sampling, cutoff=4.0))
    return with_effort(narrow, recording.session.trials[0].columns["elbow.effort"])


def test_a_push_below_the_noise_of_single_samples_is_found_where_it_lasts(
    recording: Recording,
) -> None:
    """Of noise at 50 Hz a fit up to 2 Hz leaves a quarter: 4 times its noise is no least push."""
    push = bump(12.0, 1.6)
    weak = holding(recording, 0.03 * push, -3.2 * NOISE * push, sag=0.0)
    pushed = in_a_narrow_band(weak)
    (event,) = find_events(Model(pushed), pushed)
    assert 11.9 < event.begin < 12.8 < event.end < 13.7
    quiet = in_a_narrow_band(holding(recording, np.zeros(len(TIME)), np.zeros(len(TIME)), sag=0.0))
    assert find_events(Model(quiet), quiet) == ()


def test_a_push_of_a_joint_that_never_quite_rests_is_found(recording: Recording) -> None:
    """It drifts while it is held; twenty seconds are too few for splines on all signals."""
    drift = 0.02 * np.sin(0.9 * TIME) + 0.01 * np.sin(2.1 * TIME)
    away = drift + 0.02 * bump(12.0, 0.6)
    pushed = holding(recording, away, -0.9 * bump(12.0, 0.6), sag=0.0)
    (event,) = find_events(Model(pushed), pushed)
    assert 11.8 < event.begin < 12.3 < event.end < 12.8


def test_a_joint_that_its_motor_moves_out_and_back_is_not_pushed(recording: Recording) -> None:
    moved = holding(recording, 0.03 * bump(12.0, 0.8), 0.8 * bump(12.0, 0.8))
    assert find_events(Model(moved), moved) == ()


def test_the_reaction_to_another_joint_that_moves_is_no_push(recording: Recording) -> None:
    """The elbow is held all the time; what the shoulder's quick way takes there is known."""
    still = np.zeros(len(TIME))
    held = holding(recording, still, still, sag=0.0)
    position = np.column_stack([0.6 * bump(12.0, 0.8), held.position[:, 1]])
    beside = replace(moved(held, position, RATE), joints=(1,), cache={})
    noise = held.session.trials[0].columns["elbow.effort"] - held.static[:, 1]
    reaction = beside.rigid[:, 1] - beside.static[:, 1]
    assert np.abs(beside.filtered(reaction[:, None])).max() > 10.0 * NOISE
    assert find_events(Model(beside), with_effort(beside, beside.rigid[:, 1] + noise)) == ()
    push = -0.8 * bump(16.0, 0.8)
    pushed = with_effort(beside, beside.rigid[:, 1] + noise + push)
    (event,) = find_events(Model(pushed), pushed)
    assert 15.9 < event.begin < event.end < 16.9


def test_friction_of_a_joint_that_only_moves_out_and_back_is_no_push(recording: Recording) -> None:
    """Nothing else shows its size. It takes power both ways, and who pushes gives some first."""
    away = 0.3 * bump(12.0, 2.4)
    driven = holding(recording, away, np.zeros(len(TIME)), sag=0.0)
    noise = driven.session.trials[0].columns["elbow.effort"] - driven.static[:, 1]
    rubbing = 0.8 * np.tanh(np.gradient(away, TIME) / 0.02)
    driven = with_effort(driven, driven.rigid[:, 1] + rubbing + noise)
    assert find_events(Model(driven), driven) == ()


@pytest.mark.parametrize(("share", "pushes"), [(1.7, 0), (2.6, 1)])
def test_friction_that_goes_from_one_side_to_the_other_is_no_push(
    recording: Recording, share: float, pushes: int
) -> None:
    """It creeps while its motor turns friction over: a step of twice its size."""
    still = np.zeros(len(TIME))
    held = holding(recording, 0.02 * bump(12.0, 0.8), still, sag=0.6)
    beyond = held.effort[:, 1] - share * FRICTION * bump(12.0, 0.8)
    pushed = replace(held, effort=np.column_stack([held.effort[:, 0], beyond]), joints=(1,))
    found = rest_events(replace(pushed, cache={}), 1, FRICTION, None, 0.0, [])
    assert len(list(found)) == pushes


@pytest.mark.parametrize(("yields", "pushes"), [(3e-4, 0), (-3e-4, 1), (1e-6, 1)])
def test_a_motor_that_winds_up_before_its_joint_breaks_loose_is_no_push(
    recording: Recording, yields: float, pushes: int
) -> None:
    """It went from one side of stiction to the other, in two trials: an opponent's large robot.

    What sticks yields with the torque by far more than its encoder's noise, and to a push against,
    though it moves by more than that between two samples elsewhere.
    """
    wound = np.clip((TIME - 11.4) / 0.6, 0.0, 1.0) * np.clip((12.1 - TIME) / 0.1, 0.0, 1.0)
    flicker = 1e-6 * np.random.default_rng(3).standard_normal(len(TIME))
    torque = 4.0 * FRICTION * wound
    moves = 0.3 * np.minimum(TIME - 10.5, 0.0)
    winds = holding(recording, moves + yields * wound + flicker, torque, sag=0.6)
    assert len(list(rest_events(winds, 1, FRICTION, None, 0.0, []))) == pushes


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_push_of_a_joint_that_meanwhile_creeps_on_is_found(
    recording: Recording, way: float
) -> None:
    creep = way * 1e-4 * (TIME - 10.0)
    pushed = holding(recording, creep, -0.8 * bump(12.0, 0.8), sag=0.6)
    (event,) = rest_events(pushed, 1, 0.0, None, 0.0, [])
    assert 11.9 < event.begin < 12.4 < event.end < 12.9


def test_a_joint_that_goes_to_another_place_is_not_held(recording: Recording) -> None:
    gone = holding(recording, np.where(TIME > 12.0, 0.1, 0.0), -0.8 * bump(11.8, 0.4))
    assert find_events(Model(gone), gone) == ()


def test_a_last_digit_that_flickers_is_noise() -> None:
    steps = np.where(np.arange(400) % 7 == 0, 0.06, 0.0)
    assert last_digit(steps) == pytest.approx(0.06 / np.sqrt(12.0))
    assert last_digit(np.random.default_rng(1).standard_normal(400)) == 0.0


def test_a_push_at_whose_height_the_joint_rests_is_one_event(recording: Recording) -> None:
    plateau = np.clip(1.5 * bump(12.0, 1.6), 0.0, 1.0)
    pushed = holding(recording, 0.03 * plateau, -0.8 * plateau)
    (event,) = find_events(Model(pushed), pushed)
    assert 11.9 < event.begin < 12.5 < 13.0 < event.end < 13.7


@pytest.mark.parametrize(("moves", "found"), [(0.0, 1), (0.05, 0)])
def test_a_push_between_lost_samples_is_compared_with_the_whole_rest(
    recording: Recording, moves: float, found: int
) -> None:
    """Between two gaps there is little but the push; a joint that went elsewhere rests anew."""
    away = moves * ((TIME > 11.95) & (TIME < 12.95))
    whole = holding(recording, away, -0.8 * bump(12.1, 0.7), sag=0.0)
    lost = (TIME > 11.9) & (TIME < 12.0) | (TIME > 12.9) & (TIME < 13.0)
    starts = [0, *np.flatnonzero(np.diff(np.flatnonzero(~lost)) > 1) + 1, int((~lost).sum())]
    rows = ("trial", "time", "position", "velocity", "acceleration", "effort", "measured", "extra")
    pushed = replace(
        whole,
        slices=[slice(a, b) for a, b in itertools.pairwise(map(int, starts))],
        cache={},
        **{name: getattr(whole, name)[~lost] for name in rows},
    )
    events = find_events(Model(pushed), pushed)
    assert len(events) == found
    assert all(12.0 < event.begin < 12.4 < event.end < 12.9 for event in events)


def test_a_joint_that_only_a_push_moves_has_nothing_to_fit(recording: Recording) -> None:
    """Once the push is left out its rests are no motion, whether they are kept or not."""
    pushed = holding(recording, 0.03 * bump(12.0, 0.8), -0.8 * bump(12.0, 0.8), sag=0.0)
    assert select_rows(pushed, (0,)).joints == (1,)
    left = spared(pushed, (Event(trial=0, joint=1, begin=11.5, end=13.5, peak=-0.8),))
    for rests in (False, True):
        assert select_rows(left, (0,), rests=rests).joints == ()


def test_pushes_of_a_held_joint_are_no_flipped_sign_of_its_effort(recording: Recording) -> None:
    pushes = bump(6.0, 0.8) + bump(9.0, 0.6) + bump(14.0, 0.9)
    away = bump(6.05, 0.8) + bump(9.05, 0.6) + bump(14.05, 0.9)
    held = holding(recording, 0.03 * away, np.zeros(len(TIME)), sag=0.0)
    check_signs(with_effort(held, -9.0 * pushes))
    phase = 2 * np.pi * 0.5 * TIME
    swinging = holding(recording, 0.4 * np.sin(phase), np.zeros(len(TIME)), sag=0.0)
    with pytest.raises(SessionError, match="opposite sign") as caught:
        check_signs(with_effort(swinging, -9.0 * np.sin(phase + 0.5)))
    # A whole column has no line, and a position that is turned looks alike (a stranger's).
    assert (caught.value.column, caught.value.line) == ("elbow.effort", None)
    assert "or elbow.position is counted the other way round" in str(caught.value)


def shoved(begin: float) -> np.ndarray:
    """Return a rise to 1 and a fall by a third of it, where friction holds, (n,)."""
    rising = np.clip((TIME - begin) / 0.6, 0.0, 1.0)
    falling = np.clip((TIME - begin - 0.9) / 0.6, 0.0, 1.0)
    return np.asarray(rising - 0.35 * falling)


def test_a_push_to_where_friction_holds_the_joint_is_no_flipped_sign(recording: Recording) -> None:
    """It comes back by a third of its way only, and its motor works against it all the time."""
    still = np.zeros(len(TIME))
    once = holding(recording, 0.3 * shoved(12.1), still, sag=0.0)
    check_signs(with_effort(once, -9.0 * shoved(12.0)))
    to_and_fro, both = shoved(12.1) - shoved(15.1), shoved(12.0) - shoved(15.0)
    there_and_back = holding(recording, 0.3 * to_and_fro, still, sag=0.0)
    with pytest.raises(SessionError, match="opposite sign"):
        check_signs(with_effort(there_and_back, -9.0 * both))
    # Of so little motion nothing is asked: somebody may push it to and fro.
    pushed = holding(recording, 0.03 * to_and_fro, still, sag=0.0)
    check_signs(with_effort(pushed, -9.0 * both))


def test_what_a_joint_s_motion_makes_of_its_effort_hides_no_push_of_its_rest(
    recording: Recording,
) -> None:
    """From one sample to the next the effort of a quick trial differs by more than its noise."""
    one = holding(recording, np.zeros(len(TIME)), -0.8 * bump(12.0, 0.8), sag=0.0)
    quick = holding(recording, 0.6 * np.sin(2 * np.pi * 1.1 * TIME), np.zeros(len(TIME)), sag=0.0)
    (held,), (moving,) = one.session.trials, quick.session.trials
    effort = quick.rigid[:, 1] + NOISE * np.random.default_rng(6).standard_normal(len(TIME))
    quick = with_effort(quick, effort)
    moving = replace(moving, file="b.csv", columns={**moving.columns, "elbow.effort": effort})
    assert np.median(np.abs(np.diff(effort))) > 3.0 * NOISE
    rows = ("position", "velocity", "acceleration", "effort", "measured", "extra")
    both = replace(
        one,
        session=replace(one.session, trials=(held, moving)),
        slices=[slice(0, len(TIME)), slice(len(TIME), 2 * len(TIME))],
        trial=np.repeat([0, 1], len(TIME)),
        time=np.concatenate([TIME, TIME[-1] + 1.0 + TIME]),
        cache={},
        **{name: np.concatenate([getattr(one, name), getattr(quick, name)]) for name in rows},
    )
    (event,) = find_events(Model(both), both)
    assert 11.9 < event.begin < 12.3 < 12.5 < event.end < 12.9


def test_an_effort_that_never_changes_holds_no_event(recording: Recording) -> None:
    held = holding(recording, np.zeros(len(TIME)), np.zeros(len(TIME)), sag=0.0)
    effort = held.static[:, 1] + 1e-15 * np.random.default_rng(7).standard_normal(len(TIME)) ** 9
    assert find_events(Model(held), replace(with_effort(held, effort), still=True)) == ()


@pytest.mark.parametrize("part", [0.5, 1.0])
def test_of_what_another_joint_s_motion_does_friction_may_take_any_part_and_keep_it(
    recording: Recording, part: float
) -> None:
    """The elbow sticks, and its motor only answers for what its friction does not hold."""
    still = np.zeros(len(TIME))
    held = holding(recording, still, still, sag=0.0)
    swing = 0.6 * np.sin(2 * np.pi * 1.2 * TIME) * np.clip(TIME / 3.0, 0.0, 1.0)
    both = moved(held, np.column_stack([swing, held.position[:, 1]]), RATE)
    reaction = both.rigid[:, 1] - both.static[:, 1]
    noise = NOISE * np.random.default_rng(5).standard_normal((len(TIME), 2))
    effort = both.rigid + noise
    # For a second friction keeps a torque that was needed before.
    answer = np.where(np.abs(TIME - 12.0) < 0.5, 0.8 * np.abs(reaction).max(), part * reaction)
    effort[:, 1] = both.static[:, 1] + answer + noise[:, 1]
    both = replace(both, joints=(0,), effort=both.filtered(effort), cache={})
    assert 0.8 * np.abs(reaction).max() > 7.0 * NOISE
    assert not [event for event in find_events(Model(both), both) if event.joint == 1]


def test_a_push_in_a_course_that_only_rises_is_found(recording: Recording) -> None:
    """Every sample of such a course is its own median, so nothing is usual there."""
    creep = np.linspace(0.0, 0.5, len(TIME)) ** 2
    held = holding(recording, np.zeros(len(TIME)), creep, sag=0.0)
    smooth = held.static[:, 1] + creep - 0.8 * bump(12.0, 0.8)
    (event,) = find_events(Model(held), with_effort(held, smooth))
    assert 11.9 < event.begin < 12.3 < 12.5 < event.end < 12.9


@pytest.mark.parametrize(
    ("kept", "others"), [(0.4, 1.0), (0.4, 0.0), (0.7, 1.0)], ids=["moves", "rests", "stays"]
)
def test_a_hold_goes_on_after_a_push_of_which_friction_keeps_less_than_half(
    kept: float, others: float
) -> None:
    """Of a joint that its motor moves further, or that rests most of the time."""
    rising, falling = (np.clip((TIME - t) / 0.3, 0.0, 1.0) for t in (6.0, 6.5))
    position = 0.05 * (rising - (1.0 - kept) * falling)
    position += others * 0.8 * np.sin(2.0 * (TIME - 10.0)) * (TIME > 10.0)
    resting = np.abs(np.gradient(position, TIME)) < 1e-3
    first = holds(position, resting, RATE)[0]
    together = first.stop > 8.0 * RATE
    assert together == (kept < 0.5)


@pytest.mark.parametrize("pushed", [False, True])
def test_torque_that_comes_with_every_swing_of_another_joint_is_no_push(
    recording: Recording, pushed: bool
) -> None:
    """As at a wrist of a UR10e whose elbow swings: 17 events in a minute."""
    still = np.zeros(len(TIME))
    held = holding(recording, still, still, sag=0.0)
    swing = 0.6 * np.sin(2 * np.pi * 0.4 * TIME)
    both = moved(held, np.column_stack([swing, held.position[:, 1]]), RATE)
    noise = NOISE * np.random.default_rng(5).standard_normal((len(TIME), 2))
    effort = both.rigid + noise
    height = 6.0 * np.abs(both.rigid[:, 1] - both.static[:, 1]).max()
    passes = [10.0] if pushed else np.arange(2.5, 18.0, 2.5)
    effort[:, 1] += height * sum(bump(begin, 0.6) for begin in passes)
    both = replace(both, joints=(0,), effort=both.filtered(effort), cache={})
    found = [event for event in find_events(Model(both), both) if event.joint == 1]
    assert len(found) == pushed
    assert all(9.9 < event.begin < event.end < 10.7 for event in found)
