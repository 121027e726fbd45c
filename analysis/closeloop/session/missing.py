"""Samples that are missing: dropped on the way, or the last one sent again.

A log drops samples, and some write a stale one with a fresh stamp in their place. Whatever stood
there would be an invention: interpolated, it makes a torque smoother than the motor's, which looks
like a slow sensor. So a missing sample has no weight in any regression.
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.runs import runs

#: A joint this many of its encoder's steps a sample fast cannot stand still for one sample.
CLEAR_STEPS = 3.0
#: Share of missing samples that is worth a word.
WORTH_SAYING = 0.002


def without_stale(trial: Trial) -> Trial:
    """Return a trial without samples that are copies of the one before under a new stamp.

    A sample is a copy if no signal of it changed while a position was on its way: it stands where
    it was, and moved between the samples on both sides by more than the encoder's step could hide.
    """
    signals = [c for name, c in trial.columns.items() if name.endswith((".position", ".effort"))]
    if not signals:
        return trial
    same = np.all([np.diff(signal) == 0.0 for signal in signals], axis=0)
    stale = np.zeros(len(trial.time), dtype=bool)
    positions = [c for name, c in trial.columns.items() if name.endswith(".position")]
    for run in runs(same):
        # Samples first to last are equal; those after the first are in doubt.
        first, last = run.start, run.stop
        before, after = first - 1, last + 1
        if before < 0 or after >= len(trial.time):
            continue
        for position in positions:
            step = _step(position)
            into, out = position[first] - position[before], position[after] - position[last]
            if step and into * out > 0 and min(abs(into), abs(out)) >= CLEAR_STEPS * step:
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
            f"{int(stale.sum())} samples repeat the one before under a new stamp, and were left "
            "out",
        ),
    )


def _step(position: np.ndarray) -> float:
    """Return the least step of a position that moves, rad or m; 0 if it does not."""
    steps = np.abs(np.diff(position))
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
    """Return the share of samples that an even clock of the usual step would have more, of (n,).

    Of a clock that jitters a step is too long where its neighbour is too short.
    """
    steps = np.diff(time)
    usual = np.median(steps)
    longer = np.maximum(np.round(steps / usual) - 1.0, 0.0).sum()
    missing = min(longer, max(np.round((time[-1] - time[0]) / usual) + 1.0 - len(time), 0.0))
    return float(missing / (missing + len(time)))


def near_a_sample(clock: np.ndarray, stamps: np.ndarray, step: float) -> np.ndarray:
    """Return whether a sample lies within half a step of each tick of an even clock, (n,)."""
    after = np.clip(np.searchsorted(stamps, clock), 1, len(stamps) - 1)
    distance = np.minimum(np.abs(clock - stamps[after - 1]), np.abs(stamps[after] - clock))
    return np.asarray(distance <= (0.5 + 1e-6) * step)
