"""Presliding: what friction does around zero velocity, which is no reason to name another effect.

Before a joint breaks loose, its friction grows with the effort: ahead of the velocity that a model
computes it from, and over a time that the model does not know (presliding; Armstrong-Helouvry,
Dupont and Canudas de Wit 1994, section 2). What that leaves at every reversal, where acceleration
is largest, looks like a late motor or a little inertia.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, compare, takes_all
from analysis.closeloop.identification.balance.terms import Candidate, Term, kept_columns
from sim.effects.catalogue import BY_NAME
from sim.effects.motion import PRESLIDING_SHARE

HYSTERESIS = BY_NAME["hysteresis"]
#: How far friction is moved and widened in time, s.
SHIFT = 0.01
#: Ways over which friction may wind up, over the longest that is presliding: octaves, since a way
#: between two of them is a sum of both to within 3 % of the friction.
WAYS = (0.125, 0.25, 0.5, 1.0)
#: Ways over which a resistance may slip, over half the travel: octaves, for the same reason.
SLIPS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
#: Parameters of how friction turns, and their value where it turns at once.
TURNS, AT_ONCE = frozenset({"smooth"}), 1e-6
#: Standard errors that an effect has to gain beside friction that is free to do so.
MIN_Z = 3.0


def only_presliding(
    candidate: Candidate, beside: Model, model: Model, rows: Rows, least: float = 0.0
) -> bool:
    """Whether an effect does no more than correct how friction passes through zero.

    Args:
        candidate: the effect and its joint.
        beside: the model with the effect.
        model: the model without; friction may be declared in it or found before.
        rows: the samples that are fitted.
        least: held-out loss that a law of friction has to take away where friction may wind up.
    """
    effect, joint = candidate.effect, candidate.joint
    # Beside what the device itself declares, Coulomb friction is another level and no other turn.
    beside_found = any(term.rubs and term.joint == joint for term in model.terms)
    if effect.winds or (effect.rubs and beside_found):
        if effect.winds and free_winding(model, joint, model.terms) is None:
            model = _rubbing(model, joint)
        free = free_winding(model, joint, model.terms)
        if free is None or not _wound(free, beside, model, rows):
            return False
        return effect.winds or _nothing_beside(free, beside, model, rows, least)
    free = _free_presliding(model, joint, model.terms)
    return (
        free is not None and not effect.at_reversals and _nothing_beside(free, beside, model, rows)
    )


def only_slips(candidate: Candidate, beside: Model, model: Model, rows: Rows) -> bool:
    """Whether resistance that winds up over many ways predicts as well as one that rest builds.

    A sum of springs that each slip (Iwan 1966, A distributed-element model for hysteresis) is all
    that hysteresis of any form can be without a clock; a law of one way and one exponent is not,
    and what it left of such sums was called thixotropy (an opponent's). Arguments are those of
    `only_presliding`.
    """
    if HYSTERESIS.name not in candidate.effect.includes:
        return False
    slips = _slipping(model, candidate.joint)
    rest = beside.without(candidate)
    losses = evaluate(with_independent(rest, slips, rows), rows).losses
    gain, error = compare(losses, evaluate(beside, rows).losses)
    return gain <= error


def _slipping(model: Model, joint: int) -> Term:
    """Return a term of springs that each slip, over ways of any size."""
    recorded = unfitted(model.recording, joint)
    columns = np.column_stack([recorded.wound(share * recorded.travel[1], 0.0) for share in SLIPS])
    return Term(
        joint=joint,
        columns={joint: columns},
        lower=(0.0,),
        kept=tuple(range(columns.shape[1])),
        effect=HYSTERESIS,
    )


def _rubbing(model: Model, joint: int, law: str = "coulomb_friction") -> Model:
    """Return the model with a law of friction: of Coulomb's, the least that can wind up."""
    effect, theta = BY_NAME[law], dict.fromkeys(TURNS, AT_ONCE)
    columns = effect.columns(unfitted(model.recording, joint), theta)
    return model.with_term(
        Term(
            joint=joint, columns=columns, lower=effect.lower, kept=(0,), theta=theta, effect=effect
        )
    )


def rubbing_anyway(model: Model, joint: int) -> Model:
    """Return the model with plain friction of a joint of which no name says yet that it rubs.

    What somebody pushes may hide that, and every joint does.
    """
    if any(term.rubs and term.joint == joint for term in model.terms):
        return model
    return _rubbing(_rubbing(model, joint), joint, "viscous_friction")


def _nothing_beside(
    free: Term, beside: Model, model: Model, rows: Rows, least: float = 0.0
) -> bool:
    """Whether an effect gains no more than chance, or than `least`, where friction may turn."""
    worse = evaluate(model.with_term(free), rows).losses
    better = evaluate(beside.with_term(free), rows).losses
    gain, error = compare(worse, better)
    return gain < least or (gain <= MIN_Z * error and not takes_all(worse, better))


def _wound(free: Term, beside: Model, model: Model, rows: Rows) -> bool:
    """Whether the joint's friction, free to wind up over presliding's way, predicts as well.

    By one standard error, as the simpler of two models is chosen (Breiman, Friedman, Olshen and
    Stone 1984, section 3.4.3): what is known to rub anyway explains it, without another effect.
    """
    losses = evaluate(model.with_term(free), rows).losses
    gain, error = compare(losses, evaluate(beside, rows).losses)
    return gain <= error


def free_turning(model: Model, joint: int) -> list[Term]:
    """Return terms that let a joint's friction turn in any way: in time, wound up, and slipping."""
    terms = model.terms
    free = [_free_presliding(model, joint, terms), free_winding(model, joint, terms)]
    if any(term.joint == joint and term.effect is HYSTERESIS for term in terms):
        free.append(_slipping(model, joint))
    return [term for term in free if term is not None]


def with_free_presliding(model: Model, joints: Iterable[int]) -> Model:
    """Return the model with declared friction free to pass through zero in its own way.

    In time, and over the way that it winds up before it slides; at `joints`.
    """
    declared = tuple(term for term in model.terms if term.candidate is None)
    for joint in joints:
        ways = _free_presliding(model, joint, declared), free_winding(model, joint, declared)
        for free in ways:
            if free is not None:
                model = model.with_term(free)
    return model


def winding_freely(model: Model, joint: int, rows: Rows) -> Model:
    """Return the model with a joint's friction, declared or found, free to wind up; or as it is.

    Hysteresis is free to slip over ways of any size, of the same torque once it slides.
    """
    sliding = tuple(t for t in model.terms if t.effect is not None and not t.effect.winds)
    free = [free_winding(model, joint, sliding)]
    for term in model.terms:
        if term.joint == joint and term.effect is HYSTERESIS:
            slips = _slipping(model, joint)
            spread = slips.columns[joint] - term.columns[joint]
            free.append(replace(slips, columns={joint: spread}, effect=None))
    for more in free:
        if more is not None:
            model = with_independent(model, more, rows)
    return model


def _free_presliding(model: Model, joint: int, terms: tuple[Term, ...]) -> Term | None:
    """Return a term that moves and widens a joint's friction in time; None without any.

    Args:
        model: with the recording.
        joint: which.
        terms: whose friction; what the device itself declares counts too.
    """
    recording = model.recording
    columns = [term.columns[joint][:, [0]] for term in terms if term.joint == joint and term.rubs]
    if recording.device.friction[joint]:
        columns.append((recording.inverse - recording.rigid)[:, [joint]])
    if not columns:
        return None
    friction = np.concatenate(columns, axis=1)
    late, early = (recording.shifted(friction, shift) for shift in (SHIFT, -SHIFT))
    both = np.concatenate([late - early, late + early - 2.0 * friction], axis=1)
    return Term(joint=joint, columns={joint: both}, kept=tuple(range(both.shape[1])))


def free_winding(model: Model, joint: int, terms: tuple[Term, ...]) -> Term | None:
    """Return a term that lets a joint's friction wind up over presliding's way; None without any.

    Bristles bend by up to `PRESLIDING_SHARE` of half the travel before friction slides (Dahl 1968):
    what winds up over a longer way is an effect of its own, what does so over this one is not. It
    is free to turn at once besides: a law that turns slowly in speed stands for one that winds up.

    Args:
        model: with the recording.
        joint: which.
        terms: whose friction; what the device itself declares counts too.
    """
    rubbing = [t for t in terms if t.rubs and t.joint == joint and t.effect is not None]
    built_in = bool(model.recording.device.friction[joint])
    if not rubbing and not built_in:
        return None
    recorded = unfitted(model.recording, joint)
    sign = np.sign(recorded.velocity)
    at_once, own = [], []
    for term in rubbing:
        assert term.effect is not None
        theta = {**term.theta, **dict.fromkeys(TURNS & term.theta.keys(), AT_ONCE)}
        at_once.append(term.effect.columns(recorded, theta)[joint][:, list(term.kept)])
        own.append(kept_columns(term)[joint])
    if built_in:
        at_once.append(sign[:, None])
        own.append(model.recording.built_in_direction[:, [joint]])
    turned = np.concatenate(at_once, axis=1)
    level = turned * sign[:, None]
    longest = PRESLIDING_SHARE * recorded.travel[1]
    # Differences, which are nothing while the joint slides: they leave the level what it is.
    free = [turned - np.concatenate(own, axis=1)] + [
        level * (recorded.wound(share * longest, exponent) - sign)[:, None]
        for share in WAYS
        for exponent in (1.0, 0.0)
    ]
    columns = np.concatenate(free, axis=1)
    return Term(joint=joint, columns={joint: columns}, kept=tuple(range(columns.shape[1])))
