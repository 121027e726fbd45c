"""Samples that are missing: dropped on the way, or the last one sent again.

A log drops samples, and some write a stale one with a fresh stamp in their place. Whatever stood
there would be an invention: interpolated, it makes a torque smoother than the motor's, which looks
like a slow sensor. So a missing sample has no weight in any regression.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.runs import runs
from intake.words import counted

#: A joint this many of its encoder's steps a sample fast cannot stand still for one sample.
CLEAR_STEPS = 3.0
#: Steps of an effort on either side of a stand that say whether it is noisy, and the share of them
#: in which it then changes, at least: another stand may be near.
BESIDE, CHANGES = 8, 0.6
#: Share of missing samples that is worth a word.
WORTH_SAYING = 0.002
#: Steps longer than this many that the clock keeps are gaps.
GAP_STEPS = 5.5
#: Share of its step by which stamps of an even clock are rounded, at most.
EVEN = 1e-6
#: Steps around one that say what the clock keeps there: at random, more than half of so many are
#: longer only if a third of all samples is lost.
AROUND = 21


def without_stale(trial: Trial) -> Trial:
    """Return a trial without samples that are copies of the one before under a new stamp.

    A sample is a copy if no signal of it changed while a position was on its way: it stands where
    it was, and moved between the samples on both sides by more than the encoder's step could hide.
    Where it turned meanwhile, an effort has to have been on its way: a joint may stand as it turns.
    Or it leapt to where it went on at a lesser speed, beside an effort that never stood; and a log
    that held samples so did so wherever whole rows stand for half as long beside such an effort.
    """
    positions = [c for name, c in trial.columns.items() if name.endswith(".position")]
    efforts = [c for name, c in trial.columns.items() if name.endswith(".effort")]
    signals = [*positions, *efforts]
    if not signals:
        return trial
    same = np.all([np.diff(signal) == 0.0 for signal in signals], axis=0)
    stale = np.zeros(len(trial.time), dtype=bool)
    moving, driving = (
        [(signal, CLEAR_STEPS * _step(signal)) for signal in several]
        for several in (positions, efforts)
    )
    # Samples first to last are equal; those after the first are in doubt.
    stands = [(run.start, run.stop) for run in runs(same)]
    restless = [any(_restless(effort, *stand) for effort in efforts) for stand in stands]
    held = []
    for (first, last), noisy in zip(stands, restless, strict=True):
        if noisy and any(_leapt(position, least, first, last) for position, least in moving):
            held.append(last - first)
            stale[first + 1 : last + 1] = True
            continue
        before, after = first - 1, last + 1
        if before < 0 or after >= len(trial.time):
            continue
        around = before, first, last, after
        ways = [_way(position, least, *around) for position, least in moving]
        turns = any(ways) and any(_way(effort, least, *around) > 0 for effort, least in driving)
        stale[first + 1 : last + 1] = turns or any(way > 0 for way in ways)
    if held:
        long = max(2.0, 0.5 * float(np.median(held)))
        for (first, last), noisy in zip(stands, restless, strict=True):
            if noisy and last - first >= long:
                stale[first + 1 : last + 1] = True
    if not stale.any():
        return trial
    kept = ~stale
    return replace(
        trial,
        time=trial.time[kept],
        columns={name: column[kept] for name, column in trial.columns.items()},
        repairs=(
            *trial.repairs,
            counted(int(stale.sum()), "sample repeats", "samples repeat")
            + " the one before under a new stamp, and "
            + ("was" if stale.sum() == 1 else "were")
            + " left out",
        ),
    )


def _way(signal: np.ndarray, least: float, before: int, first: int, last: int, after: int) -> float:
    """Return 1 if a signal went on the same way across a stand, -1 if it turned.

    And 0 where it did not go by as much as `least` on both sides.
    """
    into, out = signal[first] - signal[before], signal[after] - signal[last]
    return float(np.sign(into * out)) if min(abs(into), abs(out)) >= least > 0.0 else 0.0


def _leapt(position: np.ndarray, least: float, first: int, last: int) -> bool:
    """Whether a joint went faster in the one step after a stand than beside it, by `least`.

    What it did in the samples that were held is in that step: at a speed that changes evenly it is
    half as long as all of them at the greater of both speeds, and here half of that will do.
    """
    out = np.abs(np.diff(position[last : last + 3]))
    into = np.abs(np.diff(position[max(first - 1, 0) : first + 1]))
    if len(out) < 2 or least <= 0.0:
        return False
    beside = max([out[1], *into])
    return bool(out[0] >= max(2.0, 0.25 * (last - first + 1)) * beside + least)


def _restless(effort: np.ndarray, first: int, last: int) -> bool:
    """Whether an effort changes with most samples beside a stand: it is noisy, or on its way."""
    before, after = effort[max(first - BESIDE, 0) : first + 1], effort[last : last + BESIDE + 1]
    return float(np.mean(np.r_[np.diff(before), np.diff(after)] != 0.0)) >= CHANGES


def _step(signal: np.ndarray) -> float:
    """Return the least step of a signal that changes, in its unit; 0 if it does not."""
    steps = np.abs(np.diff(signal))
    steps = steps[steps > 1e-12]
    return float(steps.min()) if len(steps) else 0.0


def with_missing_counted(trial: Trial) -> Trial:
    """Return a trial with a word on how many of its samples are missing, if that is worth one."""
    share = missing_share(trial.time)
    if share < WORTH_SAYING:
        return trial
    said = f"{100 * share:.1f} % of its samples are missing; no fit sees what stood there"
    return replace(trial, repairs=(*trial.repairs, said))


def missing_share(time: np.ndarray) -> float:
    """Return the share of samples that a clock would have more had it lost none, of stamps (n,)."""
    steps = np.diff(time)
    missing = _missing(steps, kept_steps(steps))
    return float(missing / (missing + len(time)))


def clock_step(time: np.ndarray) -> float:
    """Return the mean step of a clock, s, without gaps and with its lost samples, of stamps (n,).

    A clock that goes at 4 ms and at 10 ms has no usual step: its median is one of them, or neither.
    """
    steps = np.diff(time)
    if np.ptp(steps) <= EVEN * steps[0]:
        # Its mean is the same but for rounding.
        return float(np.median(steps))
    kept = kept_steps(steps)
    inside = steps <= GAP_STEPS * kept
    steps, kept = steps[inside], kept[inside]
    return float(steps.sum() / (len(steps) + _missing(steps, kept)))


def kept_steps(steps: np.ndarray) -> np.ndarray:
    """Return the step that a clock keeps at each of its steps, s, both (n,): longer ones lost some.

    It is the usual one of the recording, or of the steps around where that is longer: a clock may
    go slower for a while. Lost samples make a step a whole number of times as long; where the
    longer ones are no such multiples on average, they are another step of the same clock.
    """
    # Mirrored, so that a gap before the last sample counts once.
    around = median_filter(steps, size=AROUND, mode="mirror")
    kept = np.maximum(np.median(steps), around)
    times = steps / kept
    longer = (np.round(times) > 1.0) & (times <= GAP_STEPS)
    if longer.any() and np.cos(2.0 * np.pi * times[longer]).mean() <= 0.0:
        kept = np.where(longer, steps, kept)
    return np.asarray(kept)


def _missing(steps: np.ndarray, kept: np.ndarray) -> float:
    """Return how many samples are missing in steps of a clock that keeps steps `kept`, (n,).

    Of a clock that jitters a step is too long where its neighbour is too short.
    """
    times = steps / kept
    longer = np.maximum(np.round(times) - 1.0, 0.0).sum()
    return float(min(longer, max(np.round(times.sum()) - len(steps), 0.0)))


def measured_at(clock: np.ndarray, stamps: np.ndarray, step: float) -> np.ndarray:
    """Return which ticks of an even clock, s, (n,), something was recorded for.

    They lie between two samples of which none is lost, or within half a step of one.

    Args:
        clock: the even one, within the stamps, s, (n,).
        stamps: of the recorded samples, s, (m,).
        step: of the even clock, s.
    """
    after = np.clip(np.searchsorted(stamps, clock), 1, len(stamps) - 1)
    steps = np.diff(stamps)
    whole = np.round(steps / kept_steps(steps)) <= 1.0
    distance = np.minimum(np.abs(clock - stamps[after - 1]), np.abs(stamps[after] - clock))
    return np.asarray(whole[after - 1] | (distance <= (0.5 + 1e-6) * step))
