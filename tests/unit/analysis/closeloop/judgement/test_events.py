"""Torque that is local in time and does not come back is an event, and only that."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.events import find_events, spared, upper_octave
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.elastic import Viscoelastic
from tests.testbed.sessions.coupled import in_trials, measured
from tests.testbed.sessions.moved import moved

SECONDS, RATE, NOISE = 60.0, 50.0, 0.05
TIME = np.arange(int(SECONDS * RATE)) / RATE


def pushed(begin: float, seconds: float, peak: float) -> np.ndarray:
    """Return a smooth push, (n,)."""
    inside = (begin < TIME) & (begin + seconds > TIME)
    return np.where(inside, peak * np.sin(np.pi * (TIME - begin) / seconds) ** 2, 0.0)


@pytest.fixture
def swinging(recording: Recording) -> Recording:
    """One minute of the elbow in motion, its shoulder held; effort is what the model needs."""
    phase = 2 * np.pi * 0.4 * TIME + 0.6 * np.sin(0.31 * TIME)
    elbow = 1.0 + 0.5 * np.sin(phase)
    return moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)


def test_noise_is_no_event_where_splines_shrink_the_rest_of_it(recording: Recording) -> None:
    """Judged by what splines make smaller elsewhere, its peak of 3 deviations was an event."""
    rng, time = np.random.default_rng(119), np.arange(1000) / RATE
    waves = zip((0.35, 0.2), rng.uniform(0.2, 0.9, 2), rng.uniform(0, 6, 2), strict=True)
    elbow = 1.0 + sum(a * np.sin(2 * np.pi * f * time + p) for a, f, p in waves)
    noisy = moved(recording, np.column_stack([np.zeros(len(time)), elbow]), RATE)
    effort = np.full_like(noisy.position, np.nan)
    effort[:, 1] = noisy.inverse[:, 1] + NOISE * rng.standard_normal(len(time))
    effort[:, 1] = noisy.filtered(effort[:, [1]])[:, 0]
    quiet = replace(noisy, effort=effort, cache={})
    assert find_events(Model(quiet), quiet) == ()


def with_effort(recording: Recording, beyond: np.ndarray) -> Recording:
    """Return the recording with an effort of the model's own torque, noise and more."""
    rng = np.random.default_rng(4)
    effort = np.full_like(recording.position, np.nan)
    noise = NOISE * rng.standard_normal(len(TIME))
    effort[:, 1] = recording.inverse[:, 1] + noise + beyond
    effort[:, 1] = recording.filtered(effort[:, [1]])[:, 0]
    return replace(recording, effort=effort, cache={})


def test_how_a_link_lands_from_its_play_is_no_event(swinging: Recording) -> None:
    """When exactly it flies, and how it lands, no sample says; a push elsewhere still is one."""
    flights = [pushed(begin, 0.25, 1.0) for begin in (7.0, 22.0, 33.0, 51.0)]
    flight, knock = np.sum(flights, axis=0), pushed(22.1, 0.2, 0.7)
    recording = with_effort(swinging, flight + knock + pushed(40.0, 0.5, 1.0))
    play = Term(
        joint=1, columns={1: flight[:, None]}, kept=(0,), effect=BY_NAME["backlash"], theta={}
    )
    beside = Model(recording, terms=(play,))
    assert [round(e.begin) for e in find_events(beside, recording)] == [40]


def test_how_a_reflex_that_is_nearly_known_begins_is_no_event(swinging: Recording) -> None:
    """It begins at once, 2 % of it later than said: five pushes were told."""
    reflex = BY_NAME["stretch_reflex"]
    theta = {"side": 1.0, "delay": 0.04, "activation_time": 0.0, "speed": 0.0, "angle": 0.2}
    joint = unfitted(with_effort(swinging, np.zeros(len(TIME))), 1)
    true = reflex.columns(joint, theta)[1][:, 0]
    columns = reflex.columns(joint, {**theta, "delay": 0.042})
    term = Term(effect=reflex, joint=1, columns=columns, theta=theta, kept=(0,))
    gain = 20.0 / np.abs(true).max()
    once = np.where((TIME > 20.0) & (TIME < 23.0), gain * (true - columns[1][:, 0]), 0.0)
    shocked = with_effort(swinging, gain * columns[1][:, 0] + once)
    assert np.abs(shocked.filtered(once[:, None])).max() > 6.0 * NOISE
    assert find_events(Model(shocked, terms=(term,)), shocked) == ()
    push = pushed(31.0, 0.8, 2.0)
    both = with_effort(swinging, gain * columns[1][:, 0] + once + push)
    (event,) = find_events(Model(both, terms=(term,)), both)
    assert 30.7 < event.begin < 31.2 < 31.6 < event.end < 32.1


def test_muscles_that_are_stiffer_in_one_trial_than_in_another_push_nobody(
    recording: Recording,
) -> None:
    """Their stiffer trial had three pushes (two strangers'); one beside that still is found."""
    phase = 2 * np.pi * 0.4 * TIME + 0.6 * np.sin(0.31 * TIME)
    place = 1.0 + 0.4 * np.sin(phase) + pushed(7.0, 1.5, 0.9)
    one = moved(recording, np.column_stack([np.zeros_like(place), place]), RATE)
    trial, length = (TIME // 12.0).astype(int), int(12.0 * RATE)
    names = [f"t{number}.csv" for number in range(5)]
    session = replace(
        one.session,
        trials=tuple(Trial(file=n, label=n, group=n, role="fit") for n in names),
        limb_joints=("elbow",),
    )
    swinging = replace(
        one,
        session=session,
        trial=trial,
        slices=[slice(length * number, length * (number + 1)) for number in range(5)],
        fit_trials=tuple(range(5)),
        cache={},
    )
    limb = Viscoelastic()
    tone = np.array([6.0, 4.0, 4.1, 3.9, 4.2])[trial] * (place - 1.0)
    for push, found in ((0.0, []), (2.0, [40])):
        declared = with_effort(swinging, tone + pushed(40.0, 0.5, push))
        columns = limb.columns(unfitted(declared, 1), {})
        term = Term(joint=1, columns=columns, lower=(-np.inf,), kept=(0, 1, 2), effect=limb)
        events = find_events(Model(declared, terms=(term,)), declared)
        assert [round(event.begin) for event in events] == found


def test_noise_alone_holds_no_event(swinging: Recording) -> None:
    quiet = with_effort(swinging, np.zeros(len(TIME)))
    assert find_events(Model(quiet), quiet) == ()


def test_two_pushes_are_found_with_their_times_and_peaks(swinging: Recording) -> None:
    beyond = pushed(20.0, 1.2, 0.5) + pushed(41.0, 0.8, -0.7)
    found = with_effort(swinging, beyond)
    one, other = find_events(Model(found), found)
    assert 19.8 < one.begin < 20.5 < one.end < 21.5 and one.peak == pytest.approx(0.5, rel=0.35)
    assert 40.8 < other.begin < 41.4 < other.end < 42.0 and other.peak < -0.4


@pytest.mark.parametrize(("wave", "told"), [(0.0, 14), (0.3, 0)])
def test_many_pushes_are_found_where_the_model_is_right_between_them(
    swinging: Recording, wave: float, told: int
) -> None:
    """Three a trial were none, and K 2 % off by them: a stranger's. Of a wrong model none is."""
    begins = 3.0 + 4.1 * np.arange(14) + np.random.default_rng(7).uniform(0.0, 1.5, 14)
    signs = np.random.default_rng(8).choice([-1.0, 1.0], 14)
    pushes = sum(pushed(begin, 0.4, 2.0 * sign) for begin, sign in zip(begins, signs, strict=True))
    found = with_effort(swinging, pushes + wave * np.sin(9.0 * swinging.position[:, 1]))
    events = find_events(Model(found), found)
    assert len(events) == told
    for begin, event in zip(begins, events, strict=False):
        assert event.begin < begin + 0.2 < event.end


def test_drag_is_no_push_where_a_joint_is_fastest(recording: Recording) -> None:
    """It is fast for a few moments alone, of which splines know too little: a stranger's eight."""
    bursts = sum(pushed(begin, 0.8, 0.9) for begin in (9.0, 27.0, 44.0))
    elbow = 0.7 + 0.4 * np.sin(2 * np.pi * 0.3 * TIME) + bursts
    quick = moved(recording, np.column_stack([np.zeros_like(elbow), elbow]), RATE)
    velocity = quick.velocity[:, 1]
    loud = with_effort(quick, 0.8 * velocity * np.abs(velocity))
    assert find_events(Model(loud), loud) == ()


def test_a_push_that_holds_a_joint_still_for_a_moment_is_one_push(recording: Recording) -> None:
    """Its middle stayed in the fit of three trials, and K was 2 % off by it: a stranger's."""
    going = 2 * np.pi * 0.4 * np.minimum(TIME, 20.0), 2 * np.pi * 0.4 * np.maximum(TIME - 20.7, 0.0)
    elbow = 1.0 + 0.5 * np.sin(sum(going) + 0.5 * np.pi)
    paused = moved(recording, np.column_stack([np.zeros_like(elbow), elbow]), RATE)
    push = 2.0 * np.clip(1.0 - (np.abs(TIME - 20.35) - 0.6) / 0.1, 0.0, 1.0)
    loud = with_effort(paused, push)
    (event,) = find_events(Model(loud), loud)
    assert 19.2 < event.begin < 19.8 < 20.9 < event.end < 21.5


def test_torque_that_comes_back_wherever_the_joint_passes_is_no_event(swinging: Recording) -> None:
    there = 0.6 * np.exp(-(((swinging.position[:, 1] - 1.2) / 0.03) ** 2))
    found = with_effort(swinging, there * (swinging.velocity[:, 1] > 0))
    assert find_events(Model(found), found) == ()


def test_torque_that_comes_back_the_other_way_where_the_joint_does_is_no_event(
    recording: Recording,
) -> None:
    """An opponent's motor turned once from full torque to the opposite, and once back: a push."""
    one, other = (pushed(begin, 0.8, 1.0) for begin in (20.8, 42.05))
    elbow = 1.0 + 0.5 * np.sin(2 * np.pi * 0.4 * TIME) + 0.08 * (one - other)
    swung = moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)
    odd = with_effort(swung, 0.7 * (one - other))
    assert find_events(Model(odd), odd) == ()
    once = with_effort(swung, 0.7 * one)
    (event,) = find_events(Model(once), once)
    assert 20.4 < event.begin < 21.2 < event.end < 22.0


def test_torque_that_comes_back_at_the_same_time_of_every_trial_is_no_event(
    recording: Recording,
) -> None:
    """Each file has a clock of its own: what is as late in another one is another pass."""
    third = len(TIME) // 3
    turn = 2 * np.pi * TIME / TIME[third]
    elbow = 1.0 + 0.5 * np.sin(turn) + 0.2 * np.sin(2.0 * turn)
    repeated = moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)
    number = np.arange(len(TIME)) // third
    trials = tuple(Trial(file=f"{n}.csv", label="", group=str(n), role="fit") for n in range(3))
    repeated = replace(
        repeated,
        session=replace(repeated.session, trials=trials),
        trial=number,
        time=TIME - TIME[third] * number,
        slices=[slice(n * third, (n + 1) * third) for n in range(3)],
        fit_trials=(0, 1, 2),
        cache={},
    )
    begins = TIME[np.argmax(elbow[:third])] - 0.4 + TIME[third] * np.arange(3)
    once = with_effort(repeated, pushed(begins[1], 0.8, 0.7))
    assert [event.trial for event in find_events(Model(once), once)] == [1]
    always = with_effort(repeated, sum(pushed(begin, 0.8, 0.7) for begin in begins))
    assert find_events(Model(always), always) == ()


@pytest.mark.parametrize(("push", "events"), [(0.0, 0), (3.0, 1)])
def test_less_than_what_shakes_a_joint_all_along_is_no_event(
    recording: Recording, push: float, events: int
) -> None:
    """Its motion explains a vibration but where another phase of the controller answers it."""
    phase = 2 * np.pi * 0.4 * TIME + 0.6 * np.sin(0.31 * TIME)
    shaken, turned = np.sin(2 * np.pi * 4.0 * TIME), (TIME > 40.0) & (TIME < 41.0)
    elbow = 1.0 + 0.5 * np.sin(phase) + 3e-3 * shaken
    vibrating = moved(recording, np.column_stack([np.zeros(len(TIME)), elbow]), RATE)
    torque = 0.6 * np.where(turned, -shaken, shaken)
    found = with_effort(vibrating, torque + pushed(20.0, 0.8, push))
    assert len(find_events(Model(found), found)) == events


def test_what_rings_is_no_push(swinging: Recording) -> None:
    """The neighbour of an elastic joint felt it ring: seven pushes in an opponent's session."""
    since = TIME - 30.0
    ringing = 0.9 * np.exp(-since / 0.25) * np.sin(2 * np.pi * 4.0 * since)
    rings = with_effort(swinging, np.where(since > 0.0, ringing, 0.0) + pushed(12.0, 0.6, 0.9))
    (push,) = find_events(Model(rings), rings)
    assert 11.5 < push.begin < push.end < 13.1


def test_no_fit_uses_what_an_event_disturbed(swinging: Recording) -> None:
    event = Event(trial=0, joint=1, begin=20.0, end=21.0, peak=0.5)
    recording = with_effort(swinging, np.zeros(len(TIME)))
    rows = select_rows(spared(recording, (event,)), (0,))
    times = recording.time[rows.samples[1]]
    assert not ((times >= 20.0) & (times <= 21.0)).any() and len(times) > 100


def test_friction_that_winds_up_before_it_slides_makes_no_event_and_hides_no_push(
    swinging: Recording,
) -> None:
    """Declared as Coulomb friction; over 4 mrad it is another, and most so where it turns once."""
    friction, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004}
    bare = with_effort(swinging, np.zeros(len(TIME)))
    wound = 2.0 * unfitted(bare, 1).wound(0.004)
    columns = friction.columns(unfitted(bare, 1), theta)
    term = Term(joint=1, columns=columns, kept=(0,), theta=theta, effect=friction)
    clean = with_effort(swinging, wound)
    assert find_events(Model(clean, terms=(term,)), clean) == ()
    found = with_effort(swinging, wound + pushed(41.0, 0.8, -0.7))
    (event,) = find_events(Model(found, terms=(term,)), found)
    assert 40.8 < event.begin < 41.4 < event.end < 42.0 and event.peak < -0.4


def still(recording: Recording, effort: np.ndarray) -> Recording:
    """Return a recording in which the elbow is held at one place."""
    count = len(TIME)
    held = np.column_stack([np.zeros(count), np.ones(count)])
    trial = Trial(
        file="a.csv", label="a", group="a", role="fit", time=TIME, columns={"elbow.effort": effort}
    )
    recording = replace(
        recording,
        session=replace(recording.session, trials=(trial,)),
        slices=[slice(0, count)],
        trial=np.zeros(count, dtype=int),
        time=TIME,
        position=held,
        velocity=np.zeros_like(held),
        acceleration=np.zeros_like(held),
        joints=(1,),
        still=True,
        cache={},
    )
    noisy = np.column_stack([np.full(count, np.nan), effort])
    return replace(recording, effort=noisy)


def test_stiction_that_creeps_is_no_event_and_a_push_is(swinging: Recording) -> None:
    rng = np.random.default_rng(2)
    creep = 3.0 + 0.8 * np.tanh((TIME - 30.0) / 12.0) + NOISE * rng.standard_normal(len(TIME))
    held = still(swinging, creep)
    assert find_events(Model(held), held) == ()
    held = still(swinging, creep + pushed(25.0, 1.5, 2.0))
    (event,) = find_events(Model(held), held)
    assert 24.9 < event.begin < event.end < 26.6 and event.peak == pytest.approx(2.0, rel=0.15)


def test_a_motion_that_starts_at_once_makes_no_event(swinging: Recording) -> None:
    acceleration = np.array(swinging.acceleration)
    acceleration[:, 1] += 60.0 * np.sin(2 * np.pi * 1.3 * TIME + np.sin(TIME))
    swinging = replace(swinging, acceleration=acceleration, cache={})
    acceleration = np.array(acceleration)
    for begin in range(100, 2900, 140):
        acceleration[begin : begin + 4, 1] += 40.0
    abrupt = replace(swinging, acceleration=acceleration, cache={})
    # Of one stroke the filters make a little less than it needs.
    needed = abrupt.inverse[:, 1] - swinging.inverse[:, 1]
    missed = -0.2 * needed * (np.abs(TIME - TIME[1502]) < 1.0)
    found = with_effort(abrupt, missed)
    assert find_events(Model(found), found) == ()
    # The same where nothing starts is somebody's push.
    pushed_instead = with_effort(swinging, missed)
    assert find_events(Model(pushed_instead), pushed_instead) != ()


def test_a_stretch_that_the_model_explains_is_no_event(swinging: Recording) -> None:
    """The joint rests, is moved quickly out and back once, far from where it was otherwise."""
    position = np.array(swinging.position)
    rests = (TIME > 30.0) & (TIME < 44.0)
    position[rests, 1] = position[rests.argmax(), 1] + 0.8 * pushed(36.0, 0.8, 1.0)[rests]
    velocity = np.gradient(position, 1 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1 / RATE, axis=0)
    moved = replace(
        swinging, position=position, velocity=velocity, acceleration=acceleration, cache={}
    )
    fast = np.abs(moved.inverse[:, 1])[(TIME > 36.0) & (TIME < 36.8)].max()
    quiet = with_effort(moved, np.zeros(len(TIME)))
    assert fast > 20.0 * NOISE and find_events(Model(quiet), quiet) == ()


def test_friction_that_sticks_where_a_joint_turns_is_no_event(swinging: Recording) -> None:
    """As long as a position controller takes to turn the joint around, once longer than ever."""
    friction, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004}
    bare = with_effort(swinging, np.zeros(len(TIME)))
    sign = np.sign(bare.velocity[:, 1])
    turn = int(np.flatnonzero((np.diff(sign) != 0) & (TIME[1:] > 30.0))[0])
    stuck = 2.0 * sign
    stuck[turn : turn + 4] = np.linspace(-2.0, 2.0, 4) * sign[turn + 4]
    stuck[turn - 3 : turn] = 0.0
    term = Term(
        joint=1,
        columns=friction.columns(unfitted(bare, 1), theta),
        kept=(0,),
        theta=theta,
        effect=friction,
    )
    found = with_effort(swinging, stuck)
    assert find_events(Model(found, terms=(term,)), found) == ()
    # As much in the middle of a stroke is somebody's push.
    fastest = turn + int(np.abs(bare.velocity[turn : turn + 60, 1]).argmax())
    pushed_there = 2.0 * sign
    pushed_there[fastest - 3 : fastest + 4] -= 2.0 * sign[fastest]
    found = with_effort(swinging, pushed_there)
    assert len(find_events(Model(found, terms=(term,)), found)) == 1


def test_a_push_is_found_beside_a_turn_that_alone_would_be_excused(swinging: Recording) -> None:
    """Most is left where the joint turns, and friction may be that; as much again is left after."""
    friction, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004}
    bare = with_effort(swinging, np.zeros(len(TIME)))
    sign = np.sign(bare.velocity[:, 1])
    turn = int(np.flatnonzero((np.diff(sign) != 0) & (TIME[1:] > 30.0))[0])
    columns = friction.columns(unfitted(bare, 1), theta)
    term = Term(joint=1, columns=columns, kept=(0,), theta=theta, effect=friction)
    push = pushed(TIME[turn] - 0.35, 0.8, 1.4)
    found = with_effort(swinging, 2.0 * sign + push)
    (event,) = find_events(Model(found, terms=(term,)), found)
    assert TIME[turn] - 0.6 < event.begin < TIME[turn] < event.end < TIME[turn] + 0.8


def test_a_push_of_a_joint_that_is_always_abrupt_is_found(swinging: Recording) -> None:
    """Filters might leave as much; wherever else the motion is as quick they leave next to none."""
    acceleration = np.array(swinging.acceleration)
    acceleration[:, 1] += 150.0 * np.sin(2 * np.pi * 4.0 * TIME + np.sin(TIME))
    quick = replace(swinging, acceleration=acceleration, cache={})
    push = pushed(41.0, 0.8, -0.7)
    octave = upper_octave(quick, 1)
    assert 0.5 * octave.min() > 0.7
    found = with_effort(quick, push)
    (event,) = find_events(Model(found), found)
    assert 40.8 < event.begin < 41.4 < event.end < 42.0
    quiet = with_effort(quick, 0.0 * push)
    assert find_events(Model(quiet), quiet) == ()


def test_a_push_is_seen_beside_friction_that_no_name_says_yet() -> None:
    """In one of two trials; without plain friction in the model nothing of it stood out."""
    bare = in_trials(np.ones((2, 3), dtype=bool))
    friction = 0.13 * np.tanh(bare.velocity[:, [1]] / 0.01) * [0.0, 1.0, 0.0]
    inside = (bare.time > 5.0) & (bare.time < 6.4)
    push = 0.32 * inside[:, None] * [0.0, 1.0, 0.0]
    rubs = measured(bare, bare.inverse + friction)
    assert find_events(Model(rubs), rubs) == ()
    pushed = measured(bare, bare.inverse + friction + push)
    (event,) = find_events(Model(pushed), pushed)
    assert event.joint == 1
    assert 4.7 < event.begin < 5.1 < 6.3 < event.end < 6.7


def test_friction_of_a_motor_of_two_joints_that_sticks_where_it_turns_is_no_event() -> None:
    """It turns with the sum of two speeds, and each joint by itself moves on there."""
    motor, theta = BY_NAME["coupled_motor"], {"other_dof": 0.0, "sense": 1.0, "smooth": 0.004}
    bare = in_trials(np.ones((1, 3), dtype=bool))
    columns = motor.columns(unfitted(bare, 1), theta)
    term = Term(joint=1, columns=columns, kept=(0, 1), theta=theta, effect=motor)
    speed = bare.velocity[:, 0] + bare.velocity[:, 1]
    turns = np.flatnonzero((np.diff(np.sign(speed)) != 0) & (bare.time[1:] > 10.0))
    turn = int(turns[np.argmax(np.abs(bare.velocity[turns, 1]))])

    def beside(slips: int) -> tuple[Event, ...]:
        friction = 0.2 * np.sign(speed)
        late = slice(slips + 1, slips + 9)
        friction[late] *= -1.0
        effort = bare.inverse + friction[:, None] * [0.0, 1.0, 0.0]
        found = measured(bare, effort)
        return find_events(Model(found, terms=(term,)), found)

    assert beside(turn) == ()
    # As much where it does not turn is somebody's push.
    (event,) = beside(turn + 30)
    assert event.joint == 1 and event.begin < bare.time[turn + 35] < event.end


def test_a_push_of_more_than_matters_is_told_though_few_rows_are_like_it() -> None:
    """What splines leave counts for less where they are unsure, but is as large as it is."""
    bare = in_trials(np.ones((2, 3), dtype=bool))
    inside = (bare.time > 13.0) & (bare.time < 13.6)
    course = np.where(inside, np.sin(np.pi * (bare.time - 13.0) / 0.6) ** 2, 0.0)
    found = measured(bare, bare.inverse + 0.03 * course[:, None] * [0.0, 1.0, 0.0])
    (event,) = find_events(Model(found), found)
    assert event.joint == 1 and 12.5 < event.begin < 13.3 < event.end < 14.0
    little = measured(bare, bare.inverse + 0.012 * course[:, None] * [0.0, 1.0, 0.0])
    assert find_events(Model(little), little) == ()
