"""Laws of friction that are asked together, since one hides the other.

A richer law may have been taken for what the model lacked by then: for what another joint passes
on, say, or for two plain ones that were not asked together. What it predicts better than Coulomb
and viscous friction has to be more than luck.

A peak at low speed (Stribeck) and damping hide each other: in slow motion the one falls as the
other rises, and left-out rows miss neither alone.
"""

from collections.abc import Iterator
from dataclasses import replace

from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    LARGE_GAIN,
    PAIR_Z,
    least_gain,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import Model, evaluate, one_joint, unfitted
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.nameable import with_law
from analysis.closeloop.identification.selection import EQUAL_SHARE
from analysis.closeloop.identification.winding import with_winding
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Effect, Theta

#: Coulomb friction last: beside damping it turns at once, and without over all speeds.
PLAIN = (BY_NAME["viscous_friction"], BY_NAME["coulomb_friction"])
#: Damping, and a peak at low speed that has Coulomb friction in it.
PEAKED = (BY_NAME["viscous_friction"], BY_NAME["stribeck_friction"])
ASYMMETRIC, OFFSET = BY_NAME["asymmetric_friction"], BY_NAME["torque_offset"]


def with_plain_friction(model: Model, rows: Rows) -> Model:
    """Return the model with the plainest friction at every joint that shows no richer one."""
    for candidate in [c for c in model.effects if PLAIN[-1].name in c.effect.includes]:
        for simpler in _plainer(model, candidate, rows):
            if not predicts_better(simpler, model, candidate.joint, rows):
                model = simpler
                break
        else:
            model = _without_twice(model, candidate, rows)
    return model


def _plainer(model: Model, candidate: Candidate, rows: Rows) -> Iterator[Model]:
    """Yield the model with plainer laws in the place of a richer one, the plainest first.

    Laws that it includes turn, and fall with the speed, as it does: a share of the load that is
    nothing leaves them.
    """
    bare, joint = model.without(candidate), candidate.joint
    yield _with(bare, rows, joint, PLAIN)
    included = [BY_NAME[name] for name in candidate.effect.includes]
    between = sorted((law for law in included if law not in PLAIN), key=lambda law: law.complexity)
    damped = _with(bare, rows, joint, PLAIN[:1]) if between else bare
    for law in between:
        yield _alike(damped, Candidate(effect=law, joint=joint), _theta(model, candidate), rows)


def _without_twice(model: Model, candidate: Candidate, rows: Rows) -> Model:
    """Return the model without an offset or damping that an asymmetric law has in it.

    Another level in each direction is an offset while the joint slides, and their mean slope is
    damping: one of the two is enough.
    """
    if candidate.effect is not ASYMMETRIC:
        return model
    for effect in (OFFSET, PLAIN[0]):
        other = Candidate(effect=effect, joint=candidate.joint)
        if other not in model.effects:
            continue
        bare = model.without(candidate).without(other)
        alone = _alike(bare, candidate, _theta(model, candidate), rows)
        without, worse, better = (evaluate(m, rows) for m in (bare, alone, model))
        lost, error = compare(worse.losses, better.losses)
        # They part only where the joint turns, and there friction has any value between its levels.
        # (The share is that of equals; taken here while looking at one of an opponent's joints.)
        model = model if lost > max(error, EQUAL_SHARE * (without.loss - better.loss)) else alone
    return model


def _theta(model: Model, candidate: Candidate) -> Theta:
    (theta,) = [term.theta for term in model.terms if term.candidate == candidate]
    return theta


def _alike(model: Model, candidate: Candidate, theta: Theta, rows: Rows) -> Model:
    """Return the model with a law that has what it shares with another of that one's parameters."""
    own = {parameter.name: theta[parameter.name] for parameter in candidate.effect.nonlinear}
    joint = unfitted(model.recording, candidate.joint)
    return with_law(model, candidate, own, rows, joint) or model


def predicts_better(simpler: Model, model: Model, joint: int, rows: Rows) -> bool:
    """Whether a joint's richer friction predicts better by more than luck, its turns aside.

    And no worse as it turns, since freedom to wind up fits noise.
    """
    own = rows.of_joint(joint)
    alone = [one_joint(m, evaluate(m, rows).coefficients, joint) for m in (simpler, model)]
    turning = [evaluate(m, own) for m in alone]
    if turning[1].loss >= turning[0].loss:
        return False
    worse, better = (with_winding(*fit, own)[1] for fit in zip(alone, turning, strict=True))
    return more_than_luck(worse.losses, better.losses, own.fold_of_block, ALONE_Z)


def with_peaked_friction(model: Model, rows: Rows) -> Model:
    """Return the model with damping and a peak at low speed where Coulomb friction stood for both.

    Damping alone comes first, which may be missed beside what was found since.
    """
    for joint in rows.joints:
        coulomb = Candidate(effect=PLAIN[-1], joint=joint)
        if coulomb not in model.effects:
            continue
        own = rows.of_joint(joint)
        alone = one_joint(model, evaluate(model, rows).coefficients, joint)
        bare = alone.without(coulomb).without(Candidate(effect=PLAIN[0], joint=joint))
        plain, peaked = (_with(bare, own, joint, laws) for laws in (PLAIN, PEAKED))
        now, damped, both = (evaluate(m, own) for m in (alone, plain, peaked))
        if more_than_luck(now.losses, damped.losses, own.fold_of_block):
            alone = plain
        # A pair is the best of many, and little is an error of form.
        best = min(now, damped, key=lambda score: score.loss)
        least = max(LARGE_GAIN * best.loss, least_gain(own, joint, best.losses, both.losses))
        enough = best.loss - both.loss > least
        if enough and more_than_luck(best.losses, both.losses, own.fold_of_block, PAIR_Z):
            alone = peaked
        others = tuple(term for term in model.terms if set(term.columns) != {joint})
        model = replace(model, terms=(*others, *alone.terms))
    return model


def _with(model: Model, rows: Rows, joint: int, laws: tuple[Effect, ...]) -> Model:
    """Add laws of friction to a joint, one after the other, that are neither declared nor there."""
    for effect in laws:
        there = model.declared | {other.key for other in model.effects}
        law = Candidate(effect=effect, joint=joint)
        found = None if law.key in there else tried_alone(model, rows, law)
        model = model if found is None else found[0]
    return model
