"""A base that stands askew: gravity of another direction at every joint of an arm.

Joint by joint it is a wrong zero, for the links seem to stand elsewhere, and a spring where the
axis should be upright. (A stranger's arm stood 2 and 4 degrees askew.)
"""

import numpy as np

from analysis.closeloop.identification.balance.luck import LARGE_GAIN, more_than_luck
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.nameable import beyond_physics
from sim.effects.laws.inertia import TurnedGravity

TURNED = TurnedGravity()
#: Joints that have to show it, each by more than luck.
LEAST_JOINTS = 2


def with_tilt(grown: Grown, rows: Rows) -> Grown:
    """Return what was found, with another direction of gravity for all that stood for it.

    Of a robot all but friction and what the effort passes through may have, of limbs a gravity of
    one joint, wrong zeros and what may not be named. It has to predict left-out groups better than
    these together, and by a good deal.
    """
    stands_in = _of_limb if rows.recording.limbs else _of_robot
    gone = [step for step in grown.steps if stands_in(step) or step.taken.refused]
    if not gone or len(rows.joints) < LEAST_JOINTS:
        return grown
    rest = grown.model
    for step in gone:
        rest = rest.without(step.taken.candidate)
    model = _turned(rest, rows)
    without, score = evaluate(rest, rows), evaluate(model, rows)
    gain, error = compare(grown.score.losses, score.losses)
    if gain <= max(error, LARGE_GAIN * grown.score.loss):
        return grown
    candidate = Candidate(effect=TURNED, joint=rows.joints[0])
    showing = [joint for joint in rows.joints if _shows(without.losses, score.losses, rows, joint)]
    if len(showing) < LEAST_JOINTS or beyond_physics(model, score, candidate):
        return grown
    gain, error = compare(without.losses, score.losses)
    taken = Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)
    step = Step(taken=taken, equals=(), options=(), before=without.loss)
    kept = (other for other in grown.steps if other not in gone)
    return Grown(model, score, (*kept, step))


def _turned(rest: Model, rows: Rows) -> Model:
    """Return the model with gravity of any direction."""
    joint = rows.joints[0]
    term = Term(
        effect=TURNED,
        joint=joint,
        columns=TURNED.columns(unfitted(rest.recording, joint), {}),
        lower=(-np.inf,),
        candidate=Candidate(effect=TURNED, joint=joint),
    )
    return with_independent(rest, term, rows)


def _shows(worse: np.ndarray, better: np.ndarray, rows: Rows, joint: int) -> bool:
    """Whether a joint's left-out rows are better predicted by more than luck."""
    own = rows.joint_of_block == joint
    return more_than_luck(worse[own], better[own], rows.fold_of_block[own])


def _of_robot(step: Step) -> bool:
    effect = step.taken.candidate.effect
    return not (effect.rubs or effect.channel or effect.name == "viscous_friction")


def _of_limb(step: Step) -> bool:
    return step.key[0] in (TURNED.name, "position_offset")
