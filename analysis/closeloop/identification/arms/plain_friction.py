"""Laws of friction that are asked together, since one hides the other.

A richer law may have been taken for what the model lacked by then: for what another joint passes
on, say, or for two plain ones that were not asked together. What it predicts better than Coulomb
and viscous friction has to be more than luck.

A peak at low speed (Stribeck) and damping hide each other: in slow motion the one falls as the
other rises, and left-out rows miss neither alone.
"""

from dataclasses import replace

from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    LARGE_GAIN,
    PAIR_Z,
    least_gain,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Model,
    evaluate,
    one_joint,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.winding import with_winding
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Effect

#: Coulomb friction last: beside damping it turns at once, and without over all speeds.
PLAIN = (BY_NAME["viscous_friction"], BY_NAME["coulomb_friction"])
#: Damping, and a peak at low speed that has Coulomb friction in it.
PEAKED = (BY_NAME["viscous_friction"], BY_NAME["stribeck_friction"])


def with_plain_friction(model: Model, rows: Rows) -> Model:
    """Return the model with plain friction at every joint that shows no richer one."""
    for candidate in [c for c in model.effects if PLAIN[-1].name in c.effect.includes]:
        simpler = _with(model.without(candidate), rows, candidate.joint, PLAIN)
        if not _richer(simpler, model, candidate.joint, rows):
            model = simpler
    return model


def _richer(simpler: Model, model: Model, joint: int, rows: Rows) -> bool:
    """Whether a joint's richer friction predicts better by more than luck, its turns aside."""
    own, losses = rows.of_joint(joint), []
    for each in (simpler, model):
        alone = one_joint(each, evaluate(each, rows).coefficients, joint)
        losses.append(with_winding(alone, evaluate(alone, own), own)[1].losses)
    return more_than_luck(losses[0], losses[1], own.fold_of_block, ALONE_Z)


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
