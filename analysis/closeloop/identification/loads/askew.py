"""Whether what hangs on a limb may be a gain of its effort and a zero that is wrong.

A load beside the line of the links has an inertia and a weight in two directions. A gain makes
that inertia of the links' own, and its weight too if gravity comes from elsewhere: two numbers for
three, so only where they fit as well nothing tells the two apart. Stiffness differs by the gain.
(A stranger's limbs: K was 11 to 14 % off, and sure of it.)
"""

from dataclasses import replace

from analysis.closeloop.identification.balance.luck import predicts_as_well
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.growing.steps import settled_beside
from analysis.closeloop.identification.nameable import beyond_physics
from sim.effects.catalogue import BY_NAME

GAIN, ZERO = BY_NAME["torque_gain"], BY_NAME["position_offset"]


def with_gains_askew(grown: Grown, rows: Rows) -> Grown:
    """Return what was found, each load of a limb with a gain as its equal where one does as well.

    Beside a wrong zero, as which a device out of level shows at one joint.

    Args:
        grown: the model with its effects.
        rows: the samples to fit.
    """
    return replace(grown, steps=tuple(_with_gain(step, grown, rows) for step in grown.steps))


def _with_gain(step: Step, grown: Grown, rows: Rows) -> Step:
    candidate, recording = step.taken.candidate, rows.recording
    joint = candidate.joint
    if not candidate.effect.adds_mass or joint not in recording.limbs:
        return step
    gain, zero = (Candidate(effect=effect, joint=joint) for effect in (GAIN, ZERO))
    there = {*grown.model.declared, *(one.key for one in grown.model.effects)}
    there |= {option.candidate.key for option in step.equals}
    if there & {gain.key, zero.key} or not GAIN.applies(recording, joint):
        return step
    rest = grown.model.without(candidate)
    model, score = rest, evaluate(rest, rows)
    worse = score.losses
    for one in (zero, gain):
        found = tried_alone(model, rows, one)
        if found is None:
            return step
        model, score = found
    model, score = settled_beside(model, rows, gain)
    impossible = any(beyond_physics(model, score, one) for one in (zero, gain))
    if impossible or not predicts_as_well(score, grown.score):
        return step
    better, error = compare(worse, score.losses)
    option = Option(
        candidate=gain, model=model, score=score, gain=better, z=better / error, beside=(zero,)
    )
    return replace(step, equals=(*step.equals, option))
