"""A channel's floor is its own noise, whatever the model leaves."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Carried
from analysis.closeloop.judgement.floor import floors, passes
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import Sampling

NOISE = 0.2


@pytest.fixture(scope="module")
def repeated(recording: Recording) -> Recording:
    """The rich recording, four times over."""
    count = 4
    step = 1.0 / recording.rate
    return replace(
        recording,
        sampling=Sampling(recorded=200.0, working=200.0, cutoff=20.0),
        slices=[slice(0, count * len(recording.time))],
        trial=np.tile(recording.trial, count),
        time=np.arange(count * len(recording.time)) * step,
        position=np.tile(recording.position, (count, 1)),
        velocity=np.tile(recording.velocity, (count, 1)),
        acceleration=np.tile(recording.acceleration, (count, 1)),
        effort=np.tile(recording.effort, (count, 1)),
        measured=np.tile(recording.measured, count),
        extra=np.tile(recording.extra, (count, 1)),
        cache={},
    )


def error(recording: Recording, structure: np.ndarray, *, step: float = 0.0) -> TrialError:
    """Return an error that holds a structure and noise, rounded to a step."""
    rng = np.random.default_rng(1)
    effort = structure + NOISE * rng.standard_normal(len(recording.time))
    if step:
        effort = np.round(effort / step) * step
    return TrialError(
        trial=0, joint=1, time=recording.time, effort=effort, predicted=np.zeros(len(effort))
    )


def test_what_the_model_leaves_is_no_floor(recording: Recording) -> None:
    # Five times the noise is left, in the band of the movement: the floor is the noise.
    left = 1.0 * np.sign(recording.velocity[:, 1])
    one = error(recording, np.convolve(left, np.ones(40) / 40, mode="same"))
    floor = floors(replace(recording, joints=(1,)), [one])[1]
    assert floor.source == "above the band"
    assert floor.value == pytest.approx(NOISE, rel=0.15)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_what_a_recorders_filter_leaves_above_the_band_is_no_floor(
    recording: Recording, order: int
) -> None:
    # Filtered twice, as logs are before they are published, far below the band's end.
    noise = filtfilt(*butter(order, 5.0, fs=200.0), np.random.default_rng(2).standard_normal(1000))
    one = replace(error(recording, np.zeros(len(recording.time))), effort=NOISE * noise)
    assert floors(replace(recording, joints=(1,)), [one]) == {}


@pytest.mark.parametrize("kept", [0.5, 0.9, 0.98, 1.0])
def test_noise_with_a_memory_keeps_its_floor(recording: Recording, kept: float) -> None:
    noise = lfilter([1.0], [1.0, -kept], np.random.default_rng(2).standard_normal(1000))
    one = replace(error(recording, np.zeros(len(recording.time))), effort=NOISE * noise)
    floor = floors(replace(recording, joints=(1,)), [one])[1]
    assert floor.source == "above the band"


def test_a_repeated_movement_shows_its_noise_in_the_band_too(repeated: Recording) -> None:
    one = error(repeated, 3.0 * np.sin(2.0 * repeated.position[:, 1]))
    floor = floors(replace(repeated, joints=(1,)), [one])[1]
    assert floor.source == "repeats"
    assert floor.value == pytest.approx(NOISE, rel=0.1)


def test_with_another_load_no_movement_is_repeated(repeated: Recording) -> None:
    # Every pass is a trial of its own; the second half of them carries something.
    trial = np.repeat(np.arange(4), len(repeated.time) // 4)
    ends = np.flatnonzero(np.diff(trial)) + 1
    bounds = [0, *ends.tolist(), len(trial)]
    slices = [slice(a, b) for a, b in pairwise(bounds)]
    bare = replace(repeated.session.trials[0], payload=None, added_mass=None)
    apart = replace(
        repeated,
        joints=(1,),
        trial=trial,
        slices=slices,
        session=replace(repeated.session, trials=(bare,) * 4),
    )
    carried = [
        Carried(
            trial=number,
            body="fore",
            joint=1,
            value=np.array([float(number), 0.0, 0.0, 0.0]),
            half=np.full(4, 0.01),
            moments=np.zeros(3),
            half_moments=np.zeros(3),
            felt=(0, 1, 2, 3),
            share=0.9,
        )
        for number in (1, 3)
    ]
    whole = error(apart, 5.0 * trial * (trial % 2))
    errors = [
        replace(
            whole,
            trial=number,
            time=whole.time[piece],
            effort=whole.effort[piece],
            predicted=whole.predicted[piece],
        )
        for number, piece in enumerate(slices)
    ]
    assert floors(apart, errors)[1].value > 10 * NOISE
    floor = floors(apart, errors, carried)[1]
    assert floor.value == pytest.approx(NOISE, rel=0.15)


def test_passes_of_a_movement_are_found_a_whole_period_later(repeated: Recording) -> None:
    found = list(passes(repeated))
    assert len(found) >= 3
    assert {later % 1000 for _, later in found} == {0}


def test_gaps_that_leave_no_long_piece_leave_a_floor(recording: Recording) -> None:
    """Of bursts that took every third second only the last digit was the floor, a tenth of it."""
    one = error(recording, np.zeros(len(recording.time)), step=0.05)
    for most in (300, 150):
        number = np.arange(len(one.time)) % most
        short = one.where(number < most - 10)
        floor = floors(replace(recording, joints=(1,)), [short])[1]
        assert floor.source == "above the band"
        assert floor.value == pytest.approx(NOISE, rel=0.2)


def test_what_the_user_knows_of_a_sensor_comes_first(repeated: Recording) -> None:
    session = replace(repeated.session, noise={"elbow.effort": 0.07})
    known = replace(repeated, joints=(1,), session=session)
    floor = floors(known, [error(known, np.zeros(len(known.time)))])[1]
    assert (floor.value, floor.source) == (0.07, "declared")


def test_no_floor_is_below_the_last_digit(recording: Recording) -> None:
    rounded = error(recording, np.zeros(len(recording.time)), step=0.5)
    (trial,) = recording.session.trials
    trials = (replace(trial, columns={"elbow.effort": rounded.effort}),)
    session = replace(recording.session, noise={"elbow.effort": 0.01}, trials=trials)
    floor = floors(replace(recording, joints=(1,), session=session), [rounded])[1]
    assert floor.source == "quantisation"
    assert floor.value == pytest.approx(0.5 / np.sqrt(12), rel=0.01)


def behind_filter(recording: Recording) -> Recording:
    """Return the recording of one joint with a declared low-pass of the effort."""
    trials = tuple(replace(trial, effort_filter_hz=15.0) for trial in recording.session.trials)
    return replace(recording, joints=(1,), session=replace(recording.session, trials=trials))


@pytest.mark.parametrize("step", [0.0, 0.02])
def test_noise_after_a_declared_filter_is_the_floor(recording: Recording, step: float) -> None:
    # Its last digit is a small part of it, and is not taken for all of it.
    known = behind_filter(recording)
    floor = floors(known, [error(known, np.zeros(len(known.time)), step=step)])[1]
    assert floor.source == "above the band"
    assert floor.value == pytest.approx(NOISE, rel=0.1)


def test_noise_before_a_declared_filter_has_its_part_within_the_band(recording: Recording) -> None:
    known = behind_filter(recording)
    kept = np.exp(-2.0 * np.pi * 15.0 / 200.0)
    white = np.random.default_rng(2).standard_normal(len(known.time))
    noise = lfilter([1.0 - kept], [1.0, -kept], white)
    one = replace(error(known, np.zeros(len(known.time))), effort=noise)
    assert floors(known, [one])[1].value == pytest.approx(float(np.std(noise)), rel=0.15)
