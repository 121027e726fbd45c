"""What left-out groups of every joint agree to: what joints share, and what one is to keep."""

from typing import Protocol

import numpy as np
from scipy.stats import norm, t

from analysis.closeloop.identification.balance.luck import (
    LARGE_GAIN,
    LARGE_Z,
    MIN_GAIN,
    MIN_TORQUE,
    MIN_Z,
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
#: By how much a joint's error may grow, by chance, where joints share something.
WORSE = 0.01


class Predicted(Protocol):
    """A fit to all rows, and what it loses on rows that it was not fitted to."""

    @property
    def losses(self) -> np.ndarray:
        """Of every block, (blocks,)."""

    @property
    def loss(self) -> float:
        """Of all blocks."""


def shared_by_joints(alone: Predicted, other: Predicted, rows: Rows) -> bool:
    """Whether something that joints share predicts better, and none of them worse."""
    gain = alone.loss - other.loss
    matters = MIN_TORQUE**2 * sum(rows.effort_power(joint) for joint in rows.samples)
    if gain <= max(MIN_GAIN * alone.loss, matters) or not sure(
        alone.losses, other.losses, rows.fold_of_block
    ):
        return False
    before, after = (np.bincount(rows.joint_of_block, fit.losses) for fit in (alone, other))
    return bool(np.all(after <= (1.0 + WORSE) ** 2 * before))


def sure(worse: np.ndarray, better: np.ndarray, folds: np.ndarray) -> bool:
    """Whether a gain is more than luck; as for other effects, a large one may have fewer errors.

    Args:
        worse: losses of blocks, (blocks,).
        better: the same under the other model.
        folds: number of each block's fold.
    """
    gain, error = compare(worse, better)
    if gain > MIN_Z * error or (gain > LARGE_Z * error and rank_z(worse, better) > MIN_Z):
        return True
    if takes_all(worse, better):
        return True
    return (
        gain > LARGE_GAIN * float(worse.sum())
        and gain > LARGE_Z * error
        and wins_in_folds(worse, better, folds)
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
