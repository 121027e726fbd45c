"""Plain friction in the place of a law that was taken before what is beside it was known."""

from dataclasses import replace

from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.friction.plain_friction import predicts_better
from analysis.closeloop.identification.growing.steps import settled_beside
from sim.effects.catalogue import BY_NAME


def with_plain_law(grown: Grown, rows: Rows) -> Grown:
    """Return what was found, with Coulomb friction for a richer law that nothing misses.

    What is beside it is chosen anew: before a reflex had its name, an asymmetry stood for it, and
    the reflex was then what that left. (A stranger's.)
    """
    for step in grown.steps if len(grown.steps) > 1 else ():
        candidate = step.taken.candidate
        plain = Candidate(effect=BY_NAME["coulomb_friction"], joint=candidate.joint)
        rest = grown.model.without(candidate)
        # What winds up is missed where the joint turns, and stands out there as pushes.
        law = candidate.effect.rubs and not candidate.effect.winds
        if not (law and candidate.includes(plain)):
            continue
        if (begun := tried_alone(rest, rows, plain)) is None:
            continue
        model, score = settled_beside(begun[0], rows, plain)
        if predicts_better(model, grown.model, plain.joint, rows):
            continue
        gain, error = compare(evaluate(rest, rows).losses, score.losses)
        taken = replace(
            step.taken, candidate=plain, model=model, score=score, gain=gain, z=gain / error
        )
        again = replace(step, taken=taken, equals=())
        grown = Grown(model, score, tuple(again if s is step else s for s in grown.steps))
    return grown
