"""Motors that turn with two joints: the other joint feels them too, or nobody can tell."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from analysis.closeloop.identification.balance.model import Model, unfitted, with_independent
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.nameable import MIN_UNIQUE, lowest
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.coupling import SENSES, WRIST

MOTOR = BY_NAME["coupled_motor"]
#: Pairs of joints that a sentence has room for.
MOST_PAIRS = 3


def with_other_joints(model: Model, rows: Rows) -> Model:
    """Give every motor of two joints that one of them shows to the other one, too.

    Each joint is asked alone, and the motor may be a little of what one of the two needs. That the
    other has it is evidence: here it only has to be missed (`pruned`), as what is ordinary.
    """
    there = {candidate.key for candidate in model.effects}
    for term in model.terms:
        if term.candidate is None or term.effect is not MOTOR:
            continue
        joint, other = term.candidate.joint, int(term.theta["other_dof"])
        here = Candidate(effect=MOTOR, joint=other)
        if other not in rows.joints or here.key in there:
            continue
        theta = {**term.theta, "other_dof": float(joint)}
        own = Term(
            effect=MOTOR,
            joint=other,
            columns=MOTOR.columns(unfitted(model.recording, other), theta),
            lower=lowest(model, here),
            theta=theta,
            candidate=here,
        )
        model = with_independent(model, own, rows)
    return model


def untold_motors(model: Model, rows: Rows) -> tuple[str, ...]:
    """Say of which joints these trials could not show a motor that turns with two of them.

    While one of them rests, or both go to and fro together, what it rubs and weighs is as if it
    were each joint's own.
    """
    names = [
        " and ".join(model.recording.name(joint) for joint in pair) for pair in _untold(model, rows)
    ]
    if not names:
        return ()
    more = f", and {len(names) - MOST_PAIRS} pairs more" if len(names) > MOST_PAIRS else ""
    return (
        "what a motor that turns with two joints rubs would be taken for each joint's own here: in "
        "what is fitted these do not move at once and independently: "
        f"{'; '.join(names[:MOST_PAIRS])}{more}. If there may be such a motor, as in wrists, move "
        "both at once, each to and fro at its own pace",
    )


def _untold(model: Model, rows: Rows) -> Iterator[tuple[int, int]]:
    """Yield the pairs of joints that rub and of which neither shows a motor of both."""
    recording = model.recording
    rubbing = {term.joint for term in model.terms if term.effect is not None and term.effect.rubs}
    for pair in combinations([joint for joint in rows.joints if joint in rubbing], 2):
        near = pair[1] - pair[0] <= WRIST
        if not near or recording.is_hinge(pair[0]) != recording.is_hinge(pair[1]):
            continue
        both = (pair, pair[::-1])
        if any(max(_turned(rows, *ways, sense) for ways in both) < MIN_UNIQUE for sense in SENSES):
            yield pair


def _turned(rows: Rows, joint: int, other: int, sense: float) -> float:
    """Return how often a motor of both goes another way than it would for one joint alone.

    The share of a joint's fitted samples, of the rarer of the two ways.
    """
    velocity = rows.recording.velocity[rows.samples[joint]]
    together = velocity[:, joint] + sense * velocity[:, other]
    against = float(np.mean(np.sign(together) != np.sign(velocity[:, joint])))
    return min(against, 1.0 - against)
