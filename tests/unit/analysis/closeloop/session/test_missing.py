"""Samples that are missing: none of them reaches a regression."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.missing import (
    clock_step,
    measured_at,
    missing_share,
    with_missing_counted,
    without_stale,
)
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import MeasuredLowpass, lowpass
from analysis.closeloop.session.stretches import record, without_forgotten
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.synthetic import mjcf

RATE = 200.0


def trial(rate: float = RATE, seconds: float = 6.0) -> Trial:
    """A noisy effort of an elbow that moves."""
    rng = np.random.default_rng(5)
    t = np.arange(round(rate * seconds)) / rate
    q = 1.0 + 0.6 * np.sin(4.0 * t)
    effort = 2.0 * np.cos(q) + rng.standard_normal(len(t))
    columns = {"shoulder.position": np.zeros(len(t)), "elbow.position": q, "elbow.effort": effort}
    return Trial(file="a.csv", label="a", group="a", role="fit", time=t, columns=columns)


def at(whole: Trial, rows: np.ndarray) -> Trial:
    columns = {name: column[rows] for name, column in whole.columns.items()}
    return Trial(
        file="a.csv", label="a", group="a", role="fit", time=whole.time[rows], columns=columns
    )


def recorded(*trials: Trial, cutoff: float | None = 12.0) -> Recording:
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    session = Session(folder=Path(), model="device.xml", trials=trials, kinematic_cutoff_hz=cutoff)
    return record(session, device)


def some_missing(count: int) -> np.ndarray:
    """Return which samples of a trial arrived: one in seven did not, nor did a burst of three."""
    kept = np.ones(count, dtype=bool)
    kept[5::7] = False
    kept[400:403] = False
    return kept


def test_what_stands_at_a_missing_sample_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    signal, kept = rng.standard_normal((600, 2)), some_missing(600)
    nonsense = np.where(kept[:, None], signal, 1e6)
    measured = kept.astype(float)
    low = MeasuredLowpass(measured, 8.0, RATE)
    first, second = low(signal), low(nonsense)
    assert first == pytest.approx(second, abs=1e-9)
    assert low(np.full(600, 3.0)) == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("rate", [RATE, 1000.0])
def test_effort_and_regressors_lose_the_same_samples_to_the_same_filter(rate: float) -> None:
    """A column that is the recorded effort itself leaves nothing, whatever is missing."""
    whole = trial(rate)
    kept = some_missing(len(whole.time))
    recording = recorded(at(whole, kept))
    elbow = 1
    every = recording.sampling.decimation
    step = np.arange(len(recording.time)) * every
    column = whole.columns["elbow.effort"].copy()
    if every > 1:
        known, share = (
            lowpass(one, 0.4 * recording.rate, rate) for one in (column * kept, 1.0 * kept)
        )
        column = known / np.maximum(share, 0.05)
    column = column[step][:, None]
    left = recording.filtered(column)[:, 0] - recording.effort[:, elbow]
    assert np.abs(left[recording.usable]).max() < 1e-6


@pytest.mark.parametrize("rate", [RATE, 500.0, 1000.0])
def test_an_effort_that_stays_the_same_does_so_beside_missing_samples(rate: float) -> None:
    """It sank by a thirtieth there: clean limbs of an opponent were told of seven pushes."""
    whole = trial(rate)
    whole.columns["elbow.effort"][:] = -5.0
    recording = recorded(at(whole, some_missing(len(whole.time))))
    effort = recording.effort[recording.usable, recording.joints[0]]
    assert effort == pytest.approx(-5.0, abs=1e-9)


@pytest.mark.parametrize("rate", [RATE, 1000.0])
def test_the_effort_of_one_joint_as_it_was_sensed_is_filtered_once_as_a_regressor(
    rate: float,
) -> None:
    whole = trial(rate)
    recording = recorded(at(whole, some_missing(len(whole.time))))
    own = recording.joints[0]
    again = recording.filtered(recording.sensed)[:, own]
    assert again == pytest.approx(recording.effort[:, own], abs=1e-12)
    assert np.ptp(recording.sensed[:, own]) > 1.2 * np.ptp(recording.effort[:, own])


def test_rows_inside_a_gap_are_left_out_and_the_rest_is_used() -> None:
    whole = trial()
    kept = np.ones(len(whole.time), dtype=bool)
    kept[300:304] = False
    recording = recorded(at(whole, kept))
    assert len(recording.slices) == 1
    assert not recording.measured[300:304].any() and recording.measured[299] == 1.0
    assert recording.usable.mean() > 0.98
    plenty = recorded(at(whole, np.random.default_rng(0).random(len(whole.time)) > 0.2))
    assert plenty.usable.mean() > 0.98


def test_a_short_gap_ends_no_stretch_and_no_fit_sees_what_its_filters_reach() -> None:
    """Friction and tissue remember what a joint did before; a longer gap they do not outlast."""
    whole = trial()
    kept = np.ones(len(whole.time), dtype=bool)
    kept[600:650] = False
    recording = recorded(at(whole, kept))
    assert len(recording.slices) == 1
    assert not recording.usable[600 - recording.edge + 5 : 650 + recording.edge - 5].any()
    assert recording.usable[: 600 - 2 * recording.edge].all()
    assert recording.usable[650 + 2 * recording.edge :].all()
    kept[600:680] = False
    assert len(recorded(at(whole, kept)).slices) == 2


def test_what_follows_a_gap_is_left_out_for_what_remembers() -> None:
    """A reflex answers a stretch that no sample shows: it was told as pushes (a stranger's)."""
    whole = trial()
    kept = np.ones(len(whole.time), dtype=bool)
    kept[600:650] = False
    kept[900:903] = False
    recording = recorded(at(whole, kept))
    disturbed = without_forgotten(recording).disturbed
    assert disturbed is not None
    (first, last) = np.flatnonzero(disturbed[:, 1])[[0, -1]]
    assert 650 <= first <= 650 + recording.edge and last - first == pytest.approx(60, abs=2)
    single = recorded(at(whole, some_missing(len(whole.time))))
    assert without_forgotten(single) is single


def test_what_came_before_an_early_gap_is_known() -> None:
    """It was too short to be analysed, and a limb's tissue began to relax after it (a bench's)."""
    whole = trial()
    kept = np.ones(len(whole.time), dtype=bool)
    kept[60:100] = False
    recording = recorded(at(whole, kept))
    assert recording.time[0] == whole.time[0]
    assert recording.position[:60, 1] == pytest.approx(
        whole.columns["elbow.position"][:60], abs=1e-3
    )


def test_over_a_gap_the_low_pass_of_anything_goes_on_in_a_straight_line() -> None:
    rng = np.random.default_rng(3)
    measured = np.ones(800)
    measured[300:400] = 0.0
    measured[770:] = 0.0
    low = MeasuredLowpass(measured, 8.0, RATE)
    one, other = rng.standard_normal((2, 800, 2)) + 50.0
    smooth = low(one)
    assert np.abs(np.diff(smooth[310:390], 2, axis=0)).max() < 1e-9
    assert np.ptp(smooth[780:]) < np.ptp(smooth[:300]) and smooth.min() > 45.0
    assert low(one + 2.0 * other) == pytest.approx(smooth + 2.0 * low(other), abs=1e-9)


def test_an_unbroken_trial_is_filtered_as_ever_and_nothing_is_said() -> None:
    recording = recorded(trial())
    assert recording.measured.all() and recording.usable.all()
    assert recording.session.trials[0].repairs == ()


def test_positions_between_samples_have_no_corners() -> None:
    whole = trial()
    kept = some_missing(len(whole.time))
    recording = recorded(at(whole, kept))
    inside = slice(100, -100)
    truth = -0.6 * 16.0 * np.sin(4.0 * whole.time)[: len(recording.time)]
    wrong = np.abs(recording.acceleration[inside, 1] - truth[inside])
    assert wrong.max() < 0.02 * np.abs(truth).max()


def test_a_stale_sample_under_a_fresh_stamp_counts_as_missing() -> None:
    whole = trial()
    columns = {name: column.copy() for name, column in whole.columns.items()}
    for name in columns:
        columns[name][250] = columns[name][249]
        columns[name][700:703] = columns[name][699]
    stale = Trial(file="a.csv", label="a", group="a", role="fit", time=whole.time, columns=columns)
    fresh = without_stale(stale)
    assert len(whole.time) - len(fresh.time) == 4
    assert fresh.repairs[0].startswith("4 samples repeat the one before")
    said = recorded(stale).session.trials[0].repairs
    assert any("% of its samples are missing" in line for line in said)


def test_a_stale_sample_at_a_turn_is_one_where_the_effort_was_on_its_way() -> None:
    """Held for one to three samples while the joint turned, they were pushes. (Unkind limbs.)"""
    time = np.arange(200) / 100.0
    position = 0.5 + 0.3 * np.cos(2.0 * np.pi * (time - 0.9952))
    effort = 4.0 * np.sin(2.0 * np.pi * time)
    turning = Trial(
        file="a.csv",
        label="",
        group="",
        role="fit",
        time=time,
        columns={"elbow.position": np.round(position, 7), "elbow.effort": np.round(effort, 2)},
    )
    assert without_stale(turning) is turning
    columns = {name: column.copy() for name, column in turning.columns.items()}
    for column in columns.values():
        column[100] = column[99]
    fresh = without_stale(replace(turning, columns=columns))
    assert np.array_equal(fresh.time, np.delete(time, 100))
    # A joint may stand as it turns, and an effort of few steps with it.
    columns["elbow.effort"] = np.round(effort)
    standing = replace(turning, columns=columns)
    assert without_stale(standing) is standing


def held_at_turns(whole: Trial, held: int) -> tuple[Trial, np.ndarray]:
    """Return a trial whose log held its samples from every turn on, and which are copies, (n,)."""
    columns = {name: np.round(column / 1e-4) * 1e-4 for name, column in whole.columns.items()}
    turns = np.flatnonzero(np.diff(np.sign(np.diff(whole.columns["elbow.position"])))) + 1
    copies = np.zeros(len(whole.time), dtype=bool)
    for turn in (0, *turns):
        copies[turn + 1 : turn + held] = True
        for column in columns.values():
            column[turn : turn + held] = column[turn]
    return replace(whole, columns=columns), copies


@pytest.mark.parametrize("held", [10, 16])
def test_whole_rows_of_a_noisy_effort_that_stand_before_a_leap_were_held(held: int) -> None:
    """Of 80 ms at every turn one sample in eleven was left out, and nine were pushes (a
    stranger's)."""
    stale, copies = held_at_turns(trial(), held)
    fresh = without_stale(stale)
    assert copies.sum() > 60 and np.array_equal(fresh.time, stale.time[~copies])
    assert fresh.repairs[0].startswith(f"{copies.sum()} samples repeat the one before")


def test_a_joint_that_sticks_and_slips_may_repeat_itself() -> None:
    """It leaps from stand to stand, and an effort of few steps stands beside it."""
    whole = trial()
    columns = {name: column.copy() for name, column in whole.columns.items()}
    stand = np.arange(len(whole.time)) // 20
    columns["elbow.position"] = np.where(stand % 4 < 2, 0.01, -0.01) * stand
    columns["elbow.effort"] = np.round(3.0 * np.cos(0.7 * stand))
    hunting = replace(whole, columns=columns)
    assert without_stale(hunting) is hunting


def test_a_joint_at_rest_may_repeat_itself() -> None:
    whole = trial()
    columns = {name: column.copy() for name, column in whole.columns.items()}
    columns["elbow.position"] = np.round(np.minimum(columns["elbow.position"], 1.3) / 1e-3) * 1e-3
    columns["elbow.effort"] = np.round(columns["elbow.position"], 2)
    resting = Trial(file="a.csv", label="", group="", role="fit", time=whole.time, columns=columns)
    assert without_stale(resting) is resting


def test_missing_samples_are_counted_and_a_jittering_clock_misses_none() -> None:
    whole = trial()
    kept = some_missing(len(whole.time))
    assert missing_share(whole.time[kept]) == pytest.approx(1.0 - kept.mean(), abs=0.002)
    jitter = np.random.default_rng(2).uniform(-0.2, 0.2, len(whole.time)) / RATE
    assert missing_share(whole.time + jitter) == 0.0
    # Of a stranger's, every sixteenth sample was told as missing.
    stamps = whole.time + 0.2 * np.random.default_rng(3).standard_normal(len(whole.time)) / RATE
    assert missing_share(np.sort(stamps)) < 0.006
    assert measured_at(whole.time, whole.time + jitter, 1.0 / RATE).all()
    assert with_missing_counted(whole) is whole


def test_an_even_clock_has_the_step_that_it_has_most_often_to_the_bit() -> None:
    """Its mean differs by rounding, which may put a rest on the other side of a bound."""
    stamps = 100.0 + np.arange(2100) / 500.0
    steps = np.diff(stamps)
    assert clock_step(stamps) == np.median(steps) != steps.mean()


def test_gaps_and_lost_samples_leave_the_step_of_a_clock_as_it_is() -> None:
    whole = trial()
    kept = some_missing(len(whole.time))
    kept[500:640] = False
    assert clock_step(whole.time[kept]) == pytest.approx(1.0 / RATE, rel=1e-9)


def two_steps(short: float, long: float, slow: np.ndarray) -> np.ndarray:
    """Return the stamps, s, of a clock that goes at its long step where it is slow, (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.where(slow, long, short))])


BY_TURNS = np.arange(3000) % 200 < 70
AT_RANDOM = np.random.default_rng(4).random(3000) < 0.15


@pytest.mark.parametrize(
    ("long", "slow"),
    [
        # Steps of another length are no lost samples, wherever they stand, ...
        (0.0101, BY_TURNS),
        (0.0101, AT_RANDOM),
        (0.0101, np.arange(3000) % 2 == 0),
        # ... nor are those twice as long if they follow each other.
        (0.0084, BY_TURNS),
        # A robot's that rounds its stamps.
        (0.0050, np.arange(3000) % 3 == 0),
    ],
)
def test_a_clock_of_two_steps_lost_nothing_and_has_the_mean_rate(
    long: float, slow: np.ndarray
) -> None:
    """A stranger's 4.2 and 10 ms were told as every sixth sample missing, at a rate of 101 Hz."""
    stamps = two_steps(0.0042, long, slow)
    assert missing_share(stamps) == 0.0
    assert clock_step(stamps) == pytest.approx(np.diff(stamps).mean(), rel=1e-9)
    even = np.arange(0.0, stamps[-1], clock_step(stamps))
    assert measured_at(even, stamps, clock_step(stamps)).all()


def test_samples_that_a_clock_of_two_steps_loses_are_missing() -> None:
    stamps = two_steps(0.0042, 0.0101, BY_TURNS)
    # Three in a row, where it is slow: a step of four.
    kept = np.ones(len(stamps), dtype=bool)
    kept[1020:1023] = False
    assert missing_share(stamps[kept]) == pytest.approx(3 / len(stamps), rel=1e-9)
    even = np.arange(0.0, stamps[-1], clock_step(stamps))
    seen = measured_at(even, stamps[kept], clock_step(stamps))
    lost = (even > stamps[1020] - 0.006) & (even < stamps[1022] + 0.006)
    assert not seen[lost].any() and seen[~lost].mean() > 0.999


@pytest.mark.parametrize("lost", [slice(1, 9), slice(2990, 2998)])
def test_samples_lost_before_the_last_one_or_after_the_first_are_missing(lost: slice) -> None:
    """The gap counted as the step that the clock keeps there, and made a push of its bridge."""
    stamps = np.arange(2999) / 100.0
    kept = np.ones(len(stamps), dtype=bool)
    kept[lost] = False
    assert missing_share(stamps[kept]) == pytest.approx(8 / len(stamps), rel=1e-9)
    seen = measured_at(stamps, stamps[kept], 0.01)
    assert np.array_equal(seen, kept)


def test_an_effort_on_a_clock_of_two_steps_is_analysed_whole() -> None:
    """At the median step, no slow stretch had enough samples for any fit."""
    stamps = two_steps(0.0042, 0.0101, BY_TURNS)[:900]
    q = 1.0 + 0.6 * np.sin(4.0 * stamps)
    columns = {
        "shoulder.position": np.zeros(len(stamps)),
        "elbow.position": q,
        "elbow.effort": 2.0 * np.cos(q),
    }
    own = Trial(file="a.csv", label="a", group="a", role="fit", time=stamps, columns=columns)
    recording = recorded(own)
    assert recording.sampling.recorded == pytest.approx(1.0 / np.diff(stamps).mean(), rel=1e-9)
    assert recording.usable.all() and recording.session.trials[0].repairs == ()
    truth = 2.0 * np.cos(1.0 + 0.6 * np.sin(4.0 * recording.time))
    inside = slice(20, -20)
    assert recording.effort[inside, 1] == pytest.approx(truth[inside], abs=0.005)
