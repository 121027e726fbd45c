"""Whether these trials can name an effect at all, and whether what was fitted can be one."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.luck import LARGE_GAIN
from analysis.closeloop.identification.balance.model import (
    Model,
    impedances,
    link_changes,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, Score, takes_all
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term, kept_columns
from sim.effects.effect import Theta
from sim.effects.motion import RecordedJoint

#: An effect whose torque the declared unknowns imitate to this share cannot be named.
MIN_UNIQUE = 0.02
#: A little of what a Dahl spring stores comes back; more than this share is a drive.
MAX_GIVEN = 0.25
ONE_WAY = (
    "all movement is in one direction: friction, damping, stiffness and neutral angle cannot "
    "be told apart"
)


def refusal(model: Model, rows: Rows, candidate: Candidate, scored: Score, current: Score) -> str:
    """Say why these trials cannot name the effect, or return nothing.

    What is declared may imitate all but a little of it. That little is seen all the same where it
    alone takes nearly all that is left, in trials that it was not fitted to.
    """
    if not rows.grouped and one_way(rows, candidate.joint):
        return ONE_WAY
    if takes_all(current.losses, scored.losses):
        return ""
    large = scored.loss < (1.0 - LARGE_GAIN) * current.loss
    if candidate.effect.has_to_agree and model.effects and large:
        # Of a size that its form foretells. (A first one is said to be not identifiable.)
        return ""
    base, _ = model.base(rows)
    width = scored.variant.columns.shape[1] if scored.variant.columns.size else 0
    if not width or not base.shape[1]:
        return ""
    columns, own = scored.variant.columns, scored.coefficients[-width:]
    left = columns - base @ np.linalg.lstsq(base, columns, rcond=None)[0]
    here = {t.effect.name for t in model.terms if t.effect and t.joint == candidate.joint}
    if here.intersection(candidate.effect.includes):
        # The part that is there already does not count: only what goes beyond it has to show.
        beyond = (left**2).sum(axis=0) > MIN_UNIQUE * (columns**2).sum(axis=0)
        if beyond.any():
            columns, left, own = columns[:, beyond], left[:, beyond], own[beyond]
    unique = float(((left @ own) ** 2).sum() / max(float(((columns @ own) ** 2).sum()), 1e-300))
    if unique < MIN_UNIQUE:
        return f"what is declared imitates {100 * (1 - unique):.1f} % of its torque in these trials"
    return ""


def one_way(rows: Rows, joint: int) -> bool:
    """Whether the joint moves in one direction only."""
    velocity = rows.recording.velocity[rows.samples[joint], joint]
    forward = float(np.maximum(velocity, 0).sum())
    backward = float(np.maximum(-velocity, 0).sum())
    return min(forward, backward) < 0.05 * max(forward, backward)


def moves_one_way(rows: Rows) -> bool:
    """Whether every joint does: K, D and q0, or an offset, hide friction."""
    return all(one_way(rows, joint) for joint in rows.samples)


def refused_yet(why: str, current: Score, scored: Score) -> str:
    """Return why an effect may not be named once it is refined; empty if nothing speaks against it.

    What takes nearly all is seen, however much of it something else imitates.

    Args:
        why: why it might not be before (`refusal`).
        current: the score without it.
        scored: the score with it.
    """
    return "" if why != ONE_WAY and takes_all(current.losses, scored.losses) else why


def beyond_physics(model: Model, scored: Score, candidate: Candidate) -> str:
    """Return the parameter of a fitted effect that none such can have; empty if all can be."""
    own: dict[int, float] = {}
    split = list(model.split(scored.coefficients))
    for term, found in split:
        if term.candidate == candidate:
            own = dict(zip(term.kept, found.tolist(), strict=True))
    joint = unfitted(model.recording, candidate.joint)
    # What is loose agrees with what hangs from it as it was found.
    estimate = replace(joint.estimate, changes=link_changes(model, split))
    joint = replace(joint, estimate=estimate)
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    theta = next(part.theta for part in parts if part.candidate == candidate)
    others = [c.effect for c in model.effects if c.joint == candidate.joint and c != candidate]
    if candidate.effect.unlikely(joint, theta) and any(effect.limb for effect in others):
        # It fills what a limb's own form leaves (an opponent's waves beside cubic springs).
        return candidate.effect.name
    differs = candidate.effect.rubs and corrects(model.without(candidate), candidate)
    # Damping is a difference where some is declared, which its bound keeps from going below none.
    damped = model.recording.device.model.dof_damping[candidate.joint] > 0.0
    differs = differs or bool(candidate.effect.name == "viscous_friction" and damped)
    return candidate.effect.beyond(joint, theta, own, difference=differs)


def corrects(model: Model, candidate: Candidate) -> bool:
    """Whether friction is declared at the joint: then the effect is a difference of either sign."""
    device, joint = model.recording.device, candidate.joint
    return bool(
        device.friction[joint]
        or device.model.dof_damping[joint]
        or any(term.joint == joint and term.rubs for term in model.terms)
    )


def lowest(model: Model, candidate: Candidate) -> tuple[float, ...]:
    """Return the lower bounds of an effect's coefficients beside what the device's file declares.

    Its constant friction, the first of them, and its damping, the last, may take away as much as is
    declared.
    """
    effect, joint, device = candidate.effect, candidate.joint, model.recording.device
    lower = [effect.bound(0), *(effect.lower[1:] or effect.lower)]
    includes = (effect.name, *effect.includes)
    if "coulomb_friction" in includes:
        lower[0] -= float(device.friction[joint])
    if "viscous_friction" in includes:
        lower[-1 if effect.lower[1:] else 0] -= float(device.model.dof_damping[joint])
    return tuple(lower)


def drives(model: Model, scored: Score, candidate: Candidate) -> bool:
    """Whether the fitted friction gives energy to the joint: then it is no friction.

    Not if it would take some with the damping of its own that a limb's takes in.
    """
    term, velocity = model.terms[-1], model.recording.velocity[:, candidate.joint]
    columns = kept_columns(term)[candidate.joint]
    torque = columns @ scored.coefficients[-columns.shape[1] :]
    readings = candidate.effect.readings(unfitted(model.recording, candidate.joint), term.theta)
    own = readings.get("viscous_mean")
    if own is not None and not own.columns <= set(term.kept):
        limb = impedances(model, scored.coefficients).get(candidate.joint, {})
        torque = torque + max(0.0, limb.get("damping", 0.0)) * velocity
    power = torque * velocity
    given, taken = float(-power[power < 0].sum()), float(power[power > 0].sum())
    return given > MAX_GIVEN * taken


def with_law(
    rest: Model, candidate: Candidate, theta: Theta, rows: Rows, joint: RecordedJoint
) -> Model | None:
    """Return a model with one law more; None if it adds nothing to what is there."""
    columns = candidate.effect.columns(joint, theta)
    term = Term(
        effect=candidate.effect,
        joint=candidate.joint,
        columns=columns,
        lower=lowest(rest, candidate),
        theta=theta,
        candidate=candidate,
    )
    model = with_independent(rest, term, rows)
    return None if model is rest else model
