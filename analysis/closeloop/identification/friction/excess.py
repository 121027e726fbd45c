"""How an excess of friction is lost as a joint speeds up: its speed and power, settled together.

They make up for each other: the lower the power, the larger the excess and the lower the speed.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.luck import ALONE_Z, more_than_luck
from analysis.closeloop.identification.balance.model import evaluate, one_joint, unfitted
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.friction.settling import BEGUN, POWERS, SPEEDS, settled
from analysis.closeloop.identification.holding import with_missed
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Theta

STRIBECK, VISCOUS = BY_NAME["stribeck_friction"], BY_NAME["viscous_friction"]


def with_settled_excess(grown: Grown, rows: Rows) -> Grown:
    """Return the model with every named Stribeck law's speed and power fitted together.

    Damping, which a peak of another power may have hidden, is asked for beside it.
    """
    for step in grown.steps:
        candidate = step.taken.candidate
        if candidate.effect is STRIBECK:
            again = with_missed(
                _settled(grown, candidate, rows),
                Candidate(effect=VISCOUS, joint=candidate.joint),
                rows,
            )
            grown = (
                again if len(again.steps) == len(grown.steps) else _settled(again, candidate, rows)
            )
    return grown


def _settled(grown: Grown, candidate: Candidate, rows: Rows) -> Grown:
    """Return the model with one Stribeck law's speed and power fitted together.

    The power stays what it usually is unless another predicts better by more than luck.
    """
    (term,) = [term for term in grown.model.terms if term.candidate == candidate]
    if len(term.kept) < term.width:
        return grown
    rest = one_joint(grown.model, grown.score.coefficients, candidate.joint)
    rest = replace(rest, terms=tuple(one for one in rest.terms if one is not term))
    joint, own = unfitted(rows.recording, candidate.joint), rows.of_joint(candidate.joint)
    lower = [term.bound(column) for column in term.kept]

    def columns(theta: Theta) -> np.ndarray:
        return STRIBECK.columns(joint, theta)[candidate.joint]

    def fitted(begun: Sequence[Theta], **limits: tuple[float, float]) -> Grown:
        theta = settled(rest, own, columns, lower, begun, {"speed": SPEEDS, **limits})
        changed = replace(term, theta=theta, columns={candidate.joint: columns(theta)})
        terms = tuple(changed if one is term else one for one in grown.model.terms)
        model = replace(grown.model, terms=terms)
        return Grown(model, evaluate(model, rows), grown.steps)

    usual = fitted([term.theta])
    free = fitted([{**term.theta, "power": power} for power in BEGUN], power=POWERS)
    here = rows.joint_of_block == candidate.joint
    worse, better = usual.score.losses[here], free.score.losses[here]
    told = more_than_luck(worse, better, rows.fold_of_block[here], ALONE_Z)
    best = free if told else usual
    return best if best.score.sse < grown.score.sse else grown
