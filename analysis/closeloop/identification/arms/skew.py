"""Efforts that are logged a little before or after the positions, by the same time at all joints.

A drive's current is that of another control cycle than the encoder's reading beside it in the log.
What that leaves is in the direction of the effort's rate of change, by as much as a hundredth of
the effort in a quick motion: more than sensors do, and less than any effect of a joint. A late
drive is late at its own joint; the log is so at all of them.
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.luck import MIN_GAIN, MIN_Z
from analysis.closeloop.identification.balance.model import Model, evaluate, prediction
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.sticking import sliding
from analysis.closeloop.identification.balance.terms import Given
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.session.recording import Recording

#: Joints agree within so many standard errors, or within this share of the time.
ERRORS, SHARE = 3.0, 0.5
#: Share of what splines explain of one joint's residual that the time has to take.
MOST = 0.5
#: Share of what names take that the time of a log alone has to take to go before them. A cuff's
#: spring is late, too. (Set between 0.6 and 0.7 of two such limbs of our own, and 0.97 of a clean
#: limb of the unkind bench, 7205.)
ALONE = 0.9
NOTE = (
    "efforts are logged {:.2f} ms {} the positions, {}: that is allowed for, and is no delay of a "
    "joint"
)


def synchronised(recording: Recording) -> tuple[Recording, str]:
    """Return the recording with its motion at the times of its efforts, and a sentence of it.

    As it is, and an empty sentence, where the joints do not agree on a time, where left-out rows
    hardly miss it, and of a limb, whose one joint has nothing to agree with.
    """
    rows = select_rows(recording, recording.fit_trials)
    if len(rows.joints) < 2 or recording.limbs:
        return recording, ""
    model = with_ordinary(declared_model(recording, rows), rows)
    # Where friction turns, later than any model of it, its steps would tell the time.
    rows = sliding(model, rows, _residual(model, rows) / rows.weight)
    before = evaluate(model, rows)
    rates = _rates(model, before.coefficients)
    found = [_time(model, rows, joint, rates[:, [joint]]) for joint in rows.joints]
    time, error = agreed_time(*np.array(found).T)
    if not MIN_Z * error < abs(time) <= 1.0 / recording.sampling.recorded:
        return recording, ""
    given = {joint: time * rates[:, [joint]] for joint in recording.joints}
    if model.given is not None:
        given = {joint: own + model.given.torque[joint] for joint, own in given.items()}
    after = evaluate(replace(model, given=Given(torque=given)), rows)
    # Every joint counts alike: the loss of one that lacks more is larger by far.
    lost, left = (np.bincount(rows.joint_of_block, own.losses) for own in (before, after))
    at = np.array(rows.joints)
    if np.mean(1.0 - left[at] / lost[at]) < MIN_GAIN:
        return recording, ""
    return later(recording, time), _said(time, "at all joints alike")


def synchronised_limb(found: Trace, least: float = 0.0) -> tuple[Recording, str]:
    """Return the recording of a traced limb as `synchronised` does that of a robot.

    What was found stands in for other joints to agree with: a command that is held for a period
    acts half of it later, and beside a gain of 13 % that was a Maxwell element and a load. Several
    joints have to agree. A delay or lag of one that is shorter than a sample may be the log's: of a
    single joint nothing tells them apart if a time that surely is shorter takes `ALONE` of it.
    """
    recording, rows = found.rows.recording, found.rows
    sample, several = 1.0 / recording.sampling.recorded, len(rows.joints) > 1
    short = {
        one.candidate
        for one in found.model.channels
        if one.candidate.effect.filters and abs(next(iter(one.theta.values()))) <= sample
    }
    model = found.model.keeping(lambda candidate: candidate not in short)
    if tells_time(model) or not recording.limbs:
        return recording, ""
    before = evaluate(model, rows)
    rates = _rates(model, before.coefficients)
    times = [_time(model, rows, joint, rates[:, [joint]]) for joint in rows.joints]
    time, error = agreed_time(*np.array(times).T) if several else times[0]
    stands_in = bool(short) and not several
    if not MIN_Z * error < abs(time) <= sample - stands_in * ERRORS * error:
        return recording, ""
    if stands_in:
        least = max(least, ALONE * (before.loss - evaluate(found.model, rows).loss))
    given = {} if model.given is None else dict(model.given.torque)
    given |= {j: time * rates[:, [j]] + given.get(j, 0.0) for j in recording.joints}
    after = evaluate(replace(model, given=Given(torque=given)), rows)
    gain = before.loss - after.loss
    # What one joint lacks beside it may look late: of drag that had no name, by 7 ms.
    most = 0.0 if several else MOST * found.explainable_after.remains
    if gain < max(MIN_GAIN * before.loss, most, least):
        return recording, ""
    return later(recording, time), _said(time, "less than a sample")


def tells_time(model: Model) -> bool:
    """Whether an effect of the model is late by itself, which a log's time would stand in for."""
    return any(one.effect.channel and one.effect.filters for one in model.effects)


def _said(time: float, which: str) -> str:
    return NOTE.format(1e3 * abs(time), "before" if time > 0.0 else "after", which)


def agreed_time(times: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """Return the time that most joints agree on, s, and its standard error; infinite if none.

    Args:
        times: of every joint by itself, s, (joints,).
        errors: their standard errors, s, (joints,).
    """
    order = np.argsort(times)
    weight = np.cumsum(1.0 / errors[order])
    middle = float(times[order][np.searchsorted(weight, weight[-1] / 2.0)])
    agree = np.abs(times - middle) <= np.maximum(ERRORS * errors, SHARE * abs(middle))
    # One that is not known to half of it says nothing.
    telling = errors < SHARE * abs(middle)
    if (agree & telling).sum() < max(2.0, 0.5 * telling.sum()):
        return middle, np.inf
    own, weight = times[agree], errors[agree] ** -2.0
    mean = float(np.average(own, weights=weight))
    # Where they differ by more than their errors, these are too small.
    apart = float((weight * (own - mean) ** 2).sum()) / max(len(own) - 1, 1)
    return mean, float(np.sqrt(max(1.0, apart) / weight.sum()))


def later(recording: Recording, seconds: float) -> Recording:
    """Return the recording with every joint as it is so much later than the effort beside it, s."""
    velocity, acceleration = recording.velocity, recording.acceleration
    jerk = recording.derivative(acceleration)
    return replace(
        recording,
        position=recording.position + seconds * velocity + 0.5 * seconds**2 * acceleration,
        velocity=velocity + seconds * acceleration + 0.5 * seconds**2 * jerk,
        acceleration=acceleration + seconds * jerk,
        cache={},
    )


def _residual(model: Model, rows: Rows) -> np.ndarray:
    """Return what the fitted model leaves of every row, in units of its weight, (r,)."""
    left: np.ndarray = model.target(rows) - model.base(rows)[0] @ evaluate(model, rows).coefficients
    return left


def _rates(model: Model, coefficients: np.ndarray) -> np.ndarray:
    """Return the rate of change of the expected effort, without friction's steps, (n, joints)."""
    coefficients = np.array(coefficients)
    for term, own in model.split(coefficients):
        if term.rubs:
            own[:] = 0.0
    recording = model.recording
    expected = prediction(model, coefficients) - (recording.inverse - recording.rigid)
    return recording.derivative(np.nan_to_num(expected))


def _time(model: Model, rows: Rows, joint: int, rate: np.ndarray) -> tuple[float, float]:
    """Return by how much later a joint's motion explains its effort, s, and its standard error.

    By seconds, whose errors may be alike (Liang and Zeger 1986, Longitudinal data analysis using
    generalized linear models).
    """
    part = rows.parts[joint]
    base = model.base(rows)[0][part]
    slope = rows.stack({joint: rate}, 1)[part]
    columns = np.column_stack([slope, base[:, base.any(axis=0)]])
    inverse = np.linalg.pinv(columns.T @ columns, hermitian=True)
    target = model.target(rows)[part]
    found = inverse @ columns.T @ target
    left = columns * (target - columns @ found)[:, None]
    block = np.unique(rows.block[part], return_inverse=True)[1]
    scores = np.array([np.bincount(block, own) for own in left.T])
    spread = inverse @ (scores @ scores.T) @ inverse
    return float(found[0]), max(float(np.sqrt(spread[0, 0])), 1e-12)
