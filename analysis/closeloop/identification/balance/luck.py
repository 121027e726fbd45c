"""Whether a gain on rows that nothing was fitted to is more than luck, and enough to matter."""

import numpy as np
from scipy.stats import norm

from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    compare,
    rank_z,
    takes_all,
)

#: A gain must exceed this many of its standard errors: some 30 candidates at each of three steps.
MIN_Z = 4.0
#: The same chance where one effect alone is asked about, not the best of `TRIED` (Bonferroni 1936).
TRIED = 30
ALONE_Z = float(norm.isf(TRIED * norm.sf(MIN_Z)))
#: The same where the best pair of many is asked about.
PAIR_Z = float(norm.isf(norm.sf(MIN_Z) / TRIED))
#: Fewer seconds of motion show nothing: their spread says little of a gain's error.
LEAST_BLOCKS = 6
#: A gain that a few moments carry (inertia, at the ends of a ramp) has a large error of its own:
#: one of this share is real too if it exceeds fewer errors but comes back in several folds, or wins
#: nearly every block, and those folds that lose by it lose next to nothing.
LARGE_GAIN, LARGE_Z, LARGE_FOLDS, LARGE_LOST = 0.25, 2.5, 3, 0.05

#: Least share of the held-out loss that a gain takes, below which no number in a report changes.
MIN_GAIN = 0.03
#: A later effect has to take this share of what the first left: what a form that is a little wrong
#: leaves behind is not another effect.
MIN_LATER_GAIN = 0.2
#: Least torque that an effect must explain, over the joint's effort (both root mean square): less
#: than that is what smoothing, or a joint that is not quite held, does to the declared torque. What
#: takes nearly all that is left only has to exceed what smoothing does in these trials.
MIN_TORQUE = 0.008
#: Times what smoothing does that a limb's effect has to do which takes much of what is left: twice
#: as much torque. (Set, as that a quarter is much, while looking at seven of two opponents' limbs.)
FAR_BEYOND = 4.0


def least_gain(
    rows: Rows, joint: int, worse: np.ndarray, better: np.ndarray, *, in_form: bool = False
) -> float:
    """Return the least gain at a joint that is more than what smoothing does to its torque.

    Args:
        rows: the samples that are fitted.
        joint: its number.
        worse: losses of blocks, (blocks,), or of the joint's alone.
        better: the same under the other model.
        in_form: whether no error of smoothing can have the form of what is between the two.
    """
    least = MIN_TORQUE**2 * rows.effort_power(joint)
    if in_form or takes_all(worse, better):
        # An error of smoothing has no other form that takes nearly all of it.
        return min(least, rows.smoothing_power(joint))
    own = rows.joint_of_block == joint
    if len(worse) == len(own):
        worse, better = worse[own], better[own]
    if joint in rows.recording.limbs and takes_much(worse, better):
        # A limb's stiffness and damping take in most of what a gain or a delay does, and are wrong
        # by it: how little they leave says nothing of how much that matters.
        return min(least, FAR_BEYOND * rows.smoothing_power(joint))
    return least


def takes_much(worse: np.ndarray, better: np.ndarray) -> bool:
    """Whether much of the losses of blocks, (blocks,), is surely gone."""
    gain, error = compare(worse, better)
    return gain > max(MIN_Z * error, LARGE_GAIN * float(worse.sum()))


def least_of_joints(
    rows: Rows, worse: np.ndarray, better: np.ndarray, *, in_form: bool = False
) -> float:
    """Return the least gain of all joints together that is more than what smoothing does to them.

    What a joint does not feel asks for nothing there: a slide measured without noise that counts
    kept an arm from its load, and a shoulder that carries much weight from a spring that its
    wrist showed (an opponent's).

    Args: as of `least_gain`.
    """
    least = 0.0
    for joint in rows.joints:
        own = rows.joint_of_block == joint
        gain = float((worse[own] - better[own]).sum())
        least += min(max(gain, 0.0), least_gain(rows, joint, worse, better, in_form=in_form))
    return least


def more_than_luck(
    worse: np.ndarray, better: np.ndarray, fold_of_block: np.ndarray, least_z: float = MIN_Z
) -> bool:
    """Whether a gain on rows that nothing was fitted to is real: by its error, or by its size.

    Args: as of `wins_in_folds`, and how many errors or ranks are more than chance.
    """
    gain, error = compare(worse, better)
    if len(worse) < LEAST_BLOCKS:
        return False
    if gain > least_z * error or takes_all(worse, better):
        return True
    if gain <= LARGE_GAIN * float(worse.sum()):
        return False
    if gain > LARGE_Z * error and wins_in_folds(worse, better, fold_of_block):
        return True
    return wins_in_folds(worse, better, fold_of_block, least=1) and rank_z(worse, better) > least_z


def predicts_as_well(other: Score, score: Score) -> bool:
    """Whether one model loses no more than its standard error to the other in unseen trials.

    By one error, as the simpler of two models or the more likely of twins is taken (Breiman,
    Friedman, Olshen and Stone 1984, section 3.4.3): a share of the gain that no reader would
    notice may be many errors, and then the trials do tell.
    """
    lost, error = compare(other.losses, score.losses)
    return lost <= error


def wins_in_folds(
    worse: np.ndarray, better: np.ndarray, fold_of_block: np.ndarray, least: int = LARGE_FOLDS
) -> bool:
    """Whether a gain comes back in several folds, and those that lose by it lose next to nothing.

    Args:
        worse: losses of blocks, (blocks,).
        better: the same under the other model.
        fold_of_block: number of each block's fold.
        least: folds that have to win.
    """
    folds = np.bincount(fold_of_block, worse - better)
    won, lost = float(folds[folds > 0].sum()), float(-folds[folds < 0].sum())
    return lost < LARGE_LOST * won and int((folds > LARGE_LOST * won).sum()) >= least


def comes_in_time(left: np.ndarray, torque: np.ndarray, apart: int) -> bool:
    """Whether a torque comes when what is left does: they match better than at any other time.

    One is moved over the other, end to end, by every time but those of less than `apart` rows
    (Perkel, Gerstein and Moore 1967, Neuronal spike trains and stochastic point processes II, on
    shifted trains). A few jerks that are where they have to be are no luck, though they fill too
    few seconds for an error by seconds.

    Args:
        left: what is left without the torque, (r,).
        torque: of an effect, (r,).
        apart: rows by which one has to be moved to be at another time.
    """
    spectrum = np.fft.rfft(left) * np.conj(np.fft.rfft(torque))
    products = np.fft.irfft(spectrum, len(left))
    other = products[apart : len(left) - apart + 1]
    return len(other) > 0 and bool(products[0] > np.abs(other).max())
