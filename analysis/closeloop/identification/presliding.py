"""Presliding: what friction does around zero velocity, which is no reason to name another effect.

Before a joint breaks loose, its friction grows with the effort: ahead of the velocity that a model
computes it from, and over a time that the model does not know (presliding; Armstrong-Helouvry,
Dupont and Canudas de Wit 1994, section 2). What that leaves at every reversal, where acceleration
is largest, looks like a late motor or a little inertia.
"""

import numpy as np

from analysis.closeloop.identification.balance.model import Candidate, Model, Term, evaluate
from analysis.closeloop.identification.balance.regression import Rows, compare, takes_all

#: How far friction is moved and widened in time, s.
SHIFT = 0.01
#: Standard errors that an effect has to gain beside friction that is free to do so.
MIN_Z = 3.0


def only_presliding(candidate: Candidate, beside: Model, model: Model, rows: Rows) -> bool:
    """Whether an effect does no more than correct how friction passes through zero.

    Args:
        candidate: the effect and its joint.
        beside: the model with the effect.
        model: the model without; friction may be declared in it or found before.
        rows: the samples that are fitted.
    """
    free = _free_presliding(model, candidate.joint, model.terms)
    if free is None or candidate.effect.at_reversals:
        return False
    worse = evaluate(model.with_term(free), rows).losses
    better = evaluate(beside.with_term(free), rows).losses
    gain, error = compare(worse, better)
    return gain <= MIN_Z * error and not takes_all(worse, better)


def with_free_presliding(model: Model) -> Model:
    """Return the model with declared friction free to pass through zero in its own way."""
    declared = tuple(term for term in model.terms if term.candidate is None)
    for joint in model.recording.joints:
        free = _free_presliding(model, joint, declared)
        if free is not None:
            model = model.with_term(free)
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
