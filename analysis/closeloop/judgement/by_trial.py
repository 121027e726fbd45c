"""Whether a limb's stiffness differs from trial to trial, so that no one number describes it.

A patient's tone changes between trials, in no order that a function of time follows. What a
stiffness of each half of a trial predicts of its other half is no noise: half of what is left has
to be of that kind, beside a damping and a zero of each half's own, as friction and slow noise have.
"""

import numpy as np

from analysis.closeloop.identification.balance.luck import MIN_TORQUE
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    fitted_impedances,
    gain,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.findings import ByTrial

#: Share of what a model leaves that a half of each trial has to tell of the other.
MOST = 0.5
#: Rows of the shorter half that can tell anything: thrice as many as are fitted to it, and more.
LEAST_ROWS = 12


def by_trial(model: Model, rows: Rows) -> dict[int, ByTrial]:
    """Return the joints of limbs whose stiffness differs from trial to trial, and by how much.

    Args:
        model: declared or repaired.
        rows: the samples that were fitted.
    """
    known = fitted_impedances(model, evaluate(model, rows).coefficients)
    joints = [joint for joint in known if joint in rows.parts and len(rows.samples[joint])]
    found = {joint: _of_joint(model, rows, joint) for joint in joints}
    return {joint: own for joint, own in found.items() if own is not None}


def _of_joint(model: Model, rows: Rows, joint: int) -> ByTrial | None:
    recording, part = rows.recording, rows.parts[joint]
    coefficients = evaluate(model, rows).coefficients
    base, _ = model.base(rows)
    left = (model.target(rows) - base @ coefficients)[part]
    place, speed = recording.position[:, joint], recording.velocity[:, joint]
    own = np.column_stack([place - place.mean(), speed, np.ones_like(place)])
    columns = rows.stack(model.transformed({joint: own}), own.shape[1])[part]
    trials, block = recording.trial[rows.samples[joint]], rows.block[part]
    whole, told, changes = 0.0, 0.0, {}
    for trial in np.unique(trials):
        inside = np.flatnonzero(trials == trial)
        early = block[inside] <= np.median(block[inside])
        halves = inside[early], inside[~early]
        if min(map(len, halves)) < LEAST_ROWS:
            whole += float(left[inside] @ left[inside])
            continue
        parts = [_beside(columns[half], left[half]) for half in halves]
        for (way, torque), (other, expected) in (parts, parts[::-1]):
            found = float(way @ torque) / max(float(way @ way), 1e-300)
            whole += float(expected @ expected)
            told += float(expected @ expected - np.sum((expected - found * other) ** 2))
        change = np.linalg.lstsq(columns[inside], left[inside], rcond=None)[0]
        changes[int(trial)] = float(change[0])
    least = max(MOST * whole, MIN_TORQUE**2 * rows.effort_power(joint))
    if len(changes) < 2 or told <= least:
        return None
    known = fitted_impedances(model, coefficients)[joint]["stiffness"]
    scale = gain(model, coefficients, joint)
    size = float(np.sqrt(told / len(left))) / rows.weight[part.start]
    return ByTrial(
        rms=size, stiffness={trial: known + scale * own for trial, own in changes.items()}
    )


def _beside(columns: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the column of stiffness and a torque, (r,), less what a damping and a zero do.

    Args:
        columns: of stiffness, damping and a zero, low-passed, (r, 3).
        torque: Nm or N, low-passed, (r,).
    """
    every, beside = np.column_stack([columns[:, 0], torque]), columns[:, 1:]
    every = every - beside @ np.linalg.lstsq(beside, every, rcond=None)[0]
    return every[:, 0], every[:, 1]
