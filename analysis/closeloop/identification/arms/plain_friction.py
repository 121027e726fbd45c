"""Plain friction in the place of a richer law that nothing needs any more.

A richer law may have been taken for what the model lacked by then: for what another joint passes
on, say, or for two plain ones that were not asked together. What it predicts better than Coulomb
and viscous friction has to be more than luck.
"""

from analysis.closeloop.identification.balance.luck import ALONE_Z, more_than_luck
from analysis.closeloop.identification.balance.model import Candidate, Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.candidates import tried_alone
from sim.effects.catalogue import BY_NAME

#: Coulomb friction last: beside damping it turns at once, and without over all speeds.
PLAIN = (BY_NAME["viscous_friction"], BY_NAME["coulomb_friction"])


def with_plain_friction(model: Model, rows: Rows) -> Model:
    """Return the model with plain friction at every joint that shows no richer one."""
    for candidate in [c for c in model.effects if PLAIN[-1].name in c.effect.includes]:
        simpler = model.without(candidate)
        there = {other.key for other in simpler.effects}
        for effect in PLAIN:
            plain = Candidate(effect=effect, joint=candidate.joint)
            if plain.key not in there and plain.key not in model.declared:
                found = tried_alone(simpler, rows, plain)
                simpler = simpler if found is None else found[0]
        worse, better = evaluate(simpler, rows).losses, evaluate(model, rows).losses
        if not more_than_luck(worse, better, rows.fold_of_block, ALONE_Z):
            model = simpler
    return model
