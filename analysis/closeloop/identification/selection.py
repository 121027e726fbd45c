"""Choose the effect to add: worth its parameters, and the simplest of those that are as good."""

import numpy as np

from analysis.closeloop.identification.balance.luck import (
    LARGE_GAIN,
    LEAST_BLOCKS,
    comes_in_time,
    least_gain,
    least_of_joints,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    compare,
    takes_all,
)
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.forms import only_form
from analysis.closeloop.identification.presliding import free_turning, only_presliding, only_slips
from sim.effects.catalogue import BY_NAME

#: Candidates whose gain differs by less than this share of the best count as equal.
EQUAL_SHARE = 0.005


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
    worth = [o for o in options if _worth(o, model, current, rows, least)]
    worth = [o for o in worth if not only_presliding(o.candidate, o.model, model, rows, least)]
    worth = [o for o in worth if not only_slips(o.candidate, o.model, model, rows)]
    worth = [
        o
        for o in worth
        if o.gain > of_form
        # An error of form is not taken nearly whole by another law.
        or takes_all(current.losses, o.score.losses)
        or not _of_form(o, model, rows)
    ]
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
    # Of those that fit alike but for rounding the first of the catalogue.
    taken = min(rivals, key=lambda o: (_unlikely(o), round(_information(o), 2), _place(o)))
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


def _unlikely(option: Option) -> bool:
    """Whether an option says of its joint what its like hardly is, or would have been seen."""
    joint = unfitted(option.model.recording, option.candidate.joint)
    return option.candidate.effect.unlikely(joint, option.theta)


def _place(option: Option) -> int:
    """Return the place of an option's effect in the catalogue, the simplest first."""
    return list(BY_NAME).index(option.candidate.effect.name)


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
    simpler = {*effect.includes, *effect.grows_from}
    return effect.complexity - max(
        (BY_NAME[name].complexity for name in simpler if (name, joint) in option.replaced),
        default=0,
    )


def _worth(option: Option, model: Model, current: Score, rows: Rows, least: float) -> bool:
    """Whether a gain is more than luck, and large enough to matter."""
    twice = told_twice(option, model, current, rows)
    if option.gain <= least or not matters(option, current, rows, in_form=twice):
        return False
    return twice or more_than_luck(current.losses, option.score.losses, rows.fold_of_block)


def matters(option: Option, current: Score, rows: Rows, *, in_form: bool = False) -> bool:
    """Whether a gain is more than what smoothing does to the declared torque.

    To that of its own joint, or joint by joint to those of all that gain.

    Args:
        option: tried beside a model.
        current: that model's score.
        rows: the samples that are fitted.
        in_form: whether no error of smoothing can have the option's form.
    """
    worse, better = current.losses, option.score.losses
    own = least_gain(rows, option.candidate.joint, worse, better, in_form=in_form)
    return option.gain > min(own, least_of_joints(rows, worse, better, in_form=in_form))


def told_twice(option: Option, model: Model, current: Score, rows: Rows) -> bool:
    """Whether an effect takes a large gain at the size and at the times that its own law says.

    Its size has been asked for already (`Effect.has_to_agree`).
    """
    if not option.candidate.effect.timed or option.gain <= LARGE_GAIN * current.loss:
        return False
    seconds = int(np.sum(rows.joint_of_block == option.candidate.joint))
    if seconds < LEAST_BLOCKS:
        return False
    part, (base, _) = rows.parts[option.candidate.joint], model.base(rows)
    expected = option.model.base(rows)[0] @ option.score.coefficients
    both = np.column_stack([model.target(rows), expected])
    left, torque = (both - base @ np.linalg.lstsq(base, both, rcond=None)[0])[part].T
    return comes_in_time(left, torque, len(left) // seconds)


def _nested(option: Option, taken: Option) -> bool:
    """Whether one of the two is a special case of the other, which always fits as well."""
    a, b = option.candidate, taken.candidate
    return a.includes(b) or b.includes(a)
