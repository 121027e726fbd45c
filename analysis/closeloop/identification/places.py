"""Where a load hangs beside the line to its link's centre of mass: said where trials tell it."""

from dataclasses import replace

from analysis.closeloop.identification.balance.model import Model, estimate_of, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.searched import searched
from analysis.closeloop.identification.balance.sticking import known_friction, left_of
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.candidates import best_of
from analysis.closeloop.identification.findings import Grown
from sim.effects.laws.inertia import ASIDE, OFF_LINE, Payload
from sim.effects.motion import RecordedJoint


def with_told_places(grown: Grown, rows: Rows) -> Grown:
    """Free loads from the line to their link's centre of mass where trials tell where they are.

    To better than `OFF_LINE`, which an interval of stiffness else allows for. A load of ten
    kilograms made it as long as the stiffness itself, though trials told its place to a centimetre.
    """
    model = grown.model
    for term in model.terms:
        if term.candidate is not None and type(term.effect) is Payload and ASIDE not in term.theta:
            model = _beside(model, term, rows) or model
    if model is grown.model:
        return grown
    return replace(grown, model=model, score=evaluate(model, rows))


def _beside(model: Model, term: Term, rows: Rows) -> Model | None:
    """Return the model with a load where it fits best, None if trials do not tell where."""
    candidate = term.candidate
    assert candidate is not None
    effect, rest = candidate.effect, model.without(candidate)
    estimate = estimate_of(model, evaluate(model, rows).coefficients)
    joint = RecordedJoint(model.recording, candidate.joint, estimate)
    begin, free = effect.searches(term.theta)[-1]
    # Where friction turns, later than any model of it, its steps would tell a place.
    sure = rows.where(known_friction(model, rows, left_of(model, rows, rows)))
    theta = searched(rest, sure, candidate, joint, begin, free)
    found = best_of(rest, rows, candidate, [theta], joint)
    if found is None:
        return None
    beside, scored = found
    # About an upright axis a step aside does nothing: no fit says where the load is.
    every = leave_out(beside, rows, scored.coefficients)
    own = every.thetas.get((*candidate.key, ASIDE))
    if own is None:
        return None
    low, high = every.interval(own, theta[ASIDE])
    lever = effect.fixed(joint, {**theta, ASIDE: 1.0})[ASIDE]
    return beside if lever * (high - low) / 2.0 < OFF_LINE else None
