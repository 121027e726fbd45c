"""What left-out groups of every joint agree to: what joints share, and what one is to keep."""

from typing import Protocol

import numpy as np
from scipy.stats import norm, t

from analysis.closeloop.identification.balance.luck import (
    LARGE_FOLDS,
    LARGE_GAIN,
    LARGE_Z,
    MIN_GAIN,
    MIN_Z,
    least_gain,
    least_of_joints,
    wins_in_folds,
)
from analysis.closeloop.identification.balance.regression import (
    Rows,
    compare,
    rank_z,
    takes_all,
)
from sim.effects.catalogue import LINK_INERTIA
from sim.effects.laws.inertia import PlacedPayload

#: Effects that act on several joints of an arm at once.
SHARED = (LINK_INERTIA, PlacedPayload.name, "position_offset")
#: What every joint rubs by.
FRICTION = ("viscous_friction", "coulomb_friction")
#: Share of what is left that a load of one trial alone, or friction of few seconds, must take away.
MOST = 0.5
#: Joints that have to show it: one shows a gain or an offset as well.
SEVERAL = 2
#: By how much a joint's error may grow where joints share something, or else how often one of them
#: may speak against it by chance.
WORSE, CHANCE = 0.01, 0.05


class Predicted(Protocol):
    """A fit to all rows, and what it loses on rows that it was not fitted to."""

    @property
    def losses(self) -> np.ndarray:
        """Of every block, (blocks,)."""

    @property
    def loss(self) -> float:
        """Of all blocks."""


class LeftOut(Predicted, Protocol):
    """The same, with what is left of every row."""

    @property
    def left(self) -> np.ndarray:
        """Held-out residual, (r,)."""


def shared_by_joints(alone: Predicted, other: Predicted, rows: Rows) -> bool:
    """Whether something that joints share predicts better, and none of them worse.

    Of seven joints one loses a little by chance (found on a Rokae AR5), and of three one did by two
    standard errors where links took 98 % of all (an opponent's arm). Of one block nobody knows
    that error.
    """
    gain = alone.loss - other.loss
    matters = least_of_joints(rows, alone.losses, other.losses)
    return gain > max(MIN_GAIN * alone.loss, matters) and better_for_all(alone, other, rows)


def better_for_all(alone: Predicted, other: Predicted, rows: Rows) -> bool:
    """Whether a fit predicts better by more than luck, however little, and no joint worse.

    One of so many joints may lose by chance: all together are asked at one level. What a few
    seconds lost may always be chance by its error (a KUKA KR300's second joint eleven times its
    loss, by 1.8 errors), so it must be no large part either.
    """
    if not sure(alone.losses, other.losses, rows.fold_of_block):
        return False
    most = float(norm.isf(CHANCE / len(rows.joints)))
    for joint in rows.joints:
        own = rows.joint_of_block == joint
        before, after = alone.losses[own], other.losses[own]
        lost, error = compare(after, before)
        by_chance = lost <= most * error < np.inf and lost <= LARGE_GAIN * before.sum()
        if after.sum() > (1.0 + WORSE) ** 2 * before.sum() and not by_chance:
            return False
    return True


def sure(
    worse: np.ndarray, better: np.ndarray, folds: np.ndarray, least: int = LARGE_FOLDS
) -> bool:
    """Whether a gain is more than luck; as for other effects, a large one may have fewer errors.

    Args:
        worse: losses of blocks, (blocks,).
        better: the same under the other model.
        folds: number of each block's fold.
        least: in how many of these a gain of fewer errors has to come back.
    """
    gain, error = compare(worse, better)
    if gain > MIN_Z * error or (gain > LARGE_Z * error and rank_z(worse, better) > MIN_Z):
        return True
    if takes_all(worse, better):
        return True
    return (
        gain > LARGE_GAIN * float(worse.sum())
        and gain > LARGE_Z * error
        and wins_in_folds(worse, better, folds, least)
    )


def nested_z(without: np.ndarray, beside: np.ndarray, block: np.ndarray) -> float:
    """Return how surely left-out rows show an effect that one of two fits lacks.

    The error that the effect's own estimate brings is no evidence against it, though `compare`
    counts it so: between nested models the difference of squares is that of the residuals times
    what the effect adds, less the square of what it adds (Clark and West 2007, Approximately normal
    tests for equal predictive accuracy in nested models). With few seconds that is half of it; then
    the error is not well known either, and Student's t with as many blocks is asked. (Chosen after
    looking at joint 1 of the Panda.)

    Args:
        without: held-out residuals without the effect, (r,).
        beside: the same with it.
        block: number of each row's block.

    Returns:
        Standard errors of a normal distribution that are as rare.
    """
    shown = np.bincount(block, 2.0 * without * (without - beside))
    gain, error = compare(shown, np.zeros(len(shown)))
    return float(norm.isf(t.sf(gain / error, len(shown) - 1)))


def missed(
    without: LeftOut, whole: LeftOut, joint: int, rows: Rows, name: str = ""
) -> float | None:
    """Return the share of a joint's loss that an effect takes away; None if it is to stay.

    Two groups cannot show it in three folds. Of friction, which every joint has, both are enough
    (found on a KUKA KR300); of what is rarer they are not: a coupling came back in both by chance.
    Nor does friction that takes most of what is left of every group need more seconds to be there:
    five told no error (found on a KUKA LBR).
    """
    own = rows.joint_of_block == joint
    worse, better = without.losses[own], whole.losses[own]
    gain = float((worse - better).sum())
    least = max(MIN_GAIN * float(worse.sum()), least_gain(rows, joint, worse, better))
    share = gain / max(float(worse.sum()), 1e-300)
    if gain <= least:
        return share
    part = rows.parts[joint]
    block = np.unique(rows.block[part], return_inverse=True)[1]
    shown = nested_z(without.left[part], whole.left[part], block) > MIN_Z
    folds, wins = rows.fold_of_block[own], LARGE_FOLDS
    if name in FRICTION:
        wins = min(LARGE_FOLDS, len(rows.folds))
        if gain > MOST * float(worse.sum()) and wins_in_folds(worse, better, folds, wins):
            return None
    return None if shown or sure(worse, better, folds, wins) else share


def missed_elsewhere(without: LeftOut, whole: LeftOut, joint: int, rows: Rows) -> bool:
    """Whether other joints miss an effect of `joint`, whose place links take at their cost."""
    others = (other for other in rows.joints if other != joint)
    return any(missed(without, whole, other, rows) is None for other in others)
