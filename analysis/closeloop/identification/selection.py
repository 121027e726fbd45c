"""Choose the effect to add: worth its parameters, and the simplest of those that are as good."""

import numpy as np
from scipy.stats import norm

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    compare,
    rank_z,
    takes_all,
)
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.forms import only_form
from analysis.closeloop.identification.presliding import free_turning, only_presliding
from sim.effects.catalogue import BY_NAME

#: A gain must exceed this many of its standard errors: some 30 candidates at each of three steps.
MIN_Z = 4.0
#: The same chance where one effect alone is asked about, not the best of `TRIED` (Bonferroni 1936).
TRIED = 30
ALONE_Z = float(norm.isf(TRIED * norm.sf(MIN_Z)))
#: The same where the best pair of many is asked about.
PAIR_Z = float(norm.isf(norm.sf(MIN_Z) / TRIED))
#: Fewer seconds of motion show nothing: their spread says little of a gain's error.
LEAST_BLOCKS = 6
#: Least share of the held-out loss that a gain takes, below which no number in a report changes.
MIN_GAIN = 0.03
#: A later effect has to take this share of what the first left: what a form that is a little wrong
#: leaves behind is not another effect.
MIN_LATER_GAIN = 0.2
#: Candidates whose gain differs by less than this share of the best count as equal.
EQUAL_SHARE = 0.005
#: Least torque that an effect must explain, over the joint's effort (both root mean square): less
#: than that is what smoothing, or a joint that is not quite held, does to the declared torque. What
#: takes nearly all that is left only has to exceed what smoothing does in these trials.
MIN_TORQUE = 0.008
#: A gain that a few moments carry (inertia, at the ends of a ramp) has a large error of its own:
#: one of this share is real too if it exceeds fewer errors but comes back in several folds, or wins
#: nearly every block, and those folds that lose by it lose next to nothing.
LARGE_GAIN, LARGE_Z, LARGE_FOLDS, LARGE_LOST = 0.25, 2.5, 3, 0.05


def choose(
    options: list[Option],
    model: Model,
    current: Score,
    rows: Rows,
    least: float,
    of_form: float = 0.0,
) -> Step | None:
    """Return the simplest option that is as good as the best, or None if none is worth adding.

    Args:
        options: tried beside the model, best first.
        model: what is there.
        current: its score.
        rows: the samples that are fitted.
        least: held-out loss that an option has to take away.
        of_form: what takes away less has to be more than an error of form of what is there.
    """
    worth = [o for o in options if _worth(o, current, rows, least)]
    worth = [o for o in worth if not only_presliding(o.candidate, o.model, model, rows, least)]
    worth = [o for o in worth if o.gain > of_form or not _of_form(o, model, rows)]
    if not worth:
        return None
    best = worth[0]
    equals = []
    for option in worth:
        lost, error = compare(option.score.losses, best.score.losses)
        if lost <= error or lost <= EQUAL_SHARE * best.gain:
            equals.append(option)
    taken = min(equals, key=lambda o: (_new_parameters(o), -o.gain))
    rivals = [o for o in equals if not _nested(o, taken)]
    taken = min(rivals, key=_information)
    for twin in equals:
        # A twin with one parameter more fits at least as well; by luck, or because it is the one?
        if taken.candidate.effect.name in twin.candidate.effect.twins:
            lost, error = compare(taken.score.losses, twin.score.losses)
            if lost > error:
                taken = twin
    taken = next((o for o in equals if carries_more(o, taken)), taken)
    return Step(
        taken=taken,
        equals=tuple(o for o in equals if o is not taken and not _nested(o, taken)),
        options=tuple(options),
        before=current.loss,
    )


def carries_more(option: Option, taken: Option) -> bool:
    """Whether a mass or inertia found already makes `option` likelier than a torque gain.

    With a free inertia beside it, a payload at any distance is a gain; no coincidence speaks for
    the gain then, and what hangs on a limb has both mass and inertia.
    """
    a, b = option.candidate, taken.candidate
    beside = [c.effect for c in option.model.effects if c.joint == a.joint and c != a]
    return (
        b.effect.scales_effort
        and a.joint == b.joint
        and a.effect.adds_mass
        and any(effect.adds_mass for effect in beside)
        and not option.refused
    )


def _of_form(option: Option, model: Model, rows: Rows) -> bool:
    """Whether an option only corrects the form of what is there, or how its friction turns."""
    turning = free_turning(model, option.candidate.joint)
    return only_form(option.candidate, option.model, model, rows, turning)


def _information(option: Option) -> float:
    """Return Schwarz's criterion of an option's fit, each second of motion being one observation.

    Forms that predict left-out groups alike may differ in how well they fit: one that curves over
    the angle has to extrapolate to a group that goes further. Source: Schwarz 1978, Estimating the
    dimension of a model.
    """
    seconds = len(option.score.losses)
    misfit = np.log(max(option.score.sse, 1e-300))
    return float(seconds * misfit + _new_parameters(option) * np.log(seconds))


def _new_parameters(option: Option) -> int:
    """Return the number of parameters an option adds to the simpler form that it replaces."""
    effect, joint = option.candidate.effect, option.candidate.joint
    return effect.complexity - max(
        (BY_NAME[name].complexity for name in effect.includes if (name, joint) in option.replaced),
        default=0,
    )


def _worth(option: Option, current: Score, rows: Rows, least: float) -> bool:
    """Whether a gain is more than luck, and large enough to matter."""
    joint = option.candidate.joint
    matters = MIN_TORQUE**2 * rows.effort_power(joint)
    if takes_all(current.losses, option.score.losses):
        # An error of smoothing has no other form that takes nearly all of it.
        matters = min(matters, rows.smoothing_power(joint))
    if option.gain <= max(least, matters):
        return False
    return more_than_luck(current.losses, option.score.losses, rows.fold_of_block)


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


def _nested(option: Option, taken: Option) -> bool:
    """Whether one of the two is a special case of the other, which always fits as well."""
    a, b = option.candidate, taken.candidate
    return a.includes(b) or b.includes(a)
