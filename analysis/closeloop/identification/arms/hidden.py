"""What a joint's friction hides, and hides its friction: a late motor, for one.

Where friction turns late it predicts left-out rows no better than none, and goes; and where no
friction is, the delay takes too little to be told. Every joint rubs, so one that seems not to is
asked for what is rare beside all that is ordinary.
"""

from collections.abc import Callable

from analysis.closeloop.identification.arms.agreed import FRICTION
from analysis.closeloop.identification.arms.ordinary import ORDINARY, with_ordinary
from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    LARGE_GAIN,
    PAIR_Z,
    least_gain,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Grown, standing


def beside_friction(begun: Grown, rows: Rows, more: Callable[[Grown], Grown]) -> Grown:
    """Return what was found of a joint and its friction together, where neither shows alone.

    Args:
        begun: what was found of one joint.
        rows: its samples.
        more: adds what is rare to what stands.
    """
    (joint,) = rows.joints
    if _rubs(begun.model, joint):
        return begun
    full = with_ordinary(begun.model, rows)
    score = evaluate(full, rows)
    there = standing(full, score)
    grown = more(Grown(full, score, there))
    if {step.key for step in grown.steps} <= {step.key for step in there}:
        return begun
    grown = _missed(grown, rows)
    now, then = begun.score, grown.score
    # Several at once are the best of many, and little is an error of form.
    least = max(LARGE_GAIN * now.loss, least_gain(rows, joint, now.losses, then.losses))
    enough = now.loss - then.loss > least
    if enough and more_than_luck(now.losses, then.losses, rows.fold_of_block, PAIR_Z):
        return grown
    return begun


def _rubs(model: Model, joint: int) -> bool:
    """Whether all of a joint's ordinary friction is there, in a law of its own or in a richer."""
    found = {key for effect in model.effects for key in _laws(effect)}
    return {(name, joint) for name in FRICTION} <= model.declared | found


def _laws(candidate: Candidate) -> set[tuple[str, int]]:
    return {(name, candidate.joint) for name in (candidate.effect.name, *candidate.effect.includes)}


def _missed(grown: Grown, rows: Rows) -> Grown:
    """Return it without the ordinary effects that left-out rows do not miss, the least first."""
    while True:
        without = [
            (grown.model.without(c), c) for c in grown.model.effects if c.effect.name in ORDINARY
        ]
        scored = [(evaluate(model, rows), model, c) for model, c in without]
        idle = [
            one
            for one in scored
            if not more_than_luck(one[0].losses, grown.score.losses, rows.fold_of_block, ALONE_Z)
        ]
        if not idle:
            return grown
        score, model, gone = min(idle, key=lambda one: one[0].loss)
        steps = tuple(step for step in grown.steps if step.key != gone.key)
        grown = Grown(model, score, steps)
