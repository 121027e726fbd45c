"""Form: what a first effect leaves because its law is a little off, which is no second effect.

A law of few parameters is never quite that of a real joint. What it leaves is small beside what it
explains, and goes with the torque that it stands for, or with how friction turns. So a small second
effect has to gain beside a first one that is free to bend: a model's error of form is looked for by
adding what lets the form vary (White 1982, Maximum likelihood estimation of misspecified models).
"""

from collections.abc import Sequence

import numpy as np

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import (
    Rows,
    compare,
    scattered_folds,
    takes_all,
)
from analysis.closeloop.identification.balance.terms import Candidate, Term, kept_columns
from analysis.closeloop.identification.hat_basis import hat_basis

#: Places over position, and over velocity, at which a torque may be another share of itself. Both
#: numbers were set while looking at sessions of the unkind bench with seeds below 400.
KNOTS = 8
#: Standard errors that an effect has to gain beside forms that are free to bend.
MIN_Z = 3.0


def only_form(
    candidate: Candidate, beside: Model, model: Model, rows: Rows, turning: Sequence[Term] = ()
) -> bool:
    """Whether an effect does no more than correct the form of those found before.

    Args:
        candidate: the effect and its joint.
        beside: the model with the effect.
        model: the model without, but with those found before.
        rows: the samples that are fitted.
        turning: what lets friction turn in any way, which is part of its form.
    """
    form = free_forms(model, candidate.joint, rows)
    free = [*turning] if form is None else [form, *turning]
    if not free:
        return False
    for term in free:
        model, beside = model.with_term(term), beside.with_term(term)
    # Scattered: nobody can extrapolate a form that is free.
    folds = scattered_folds(rows)
    worse = evaluate(model, rows, fold_rows=folds).losses
    better = evaluate(beside, rows, fold_rows=folds).losses
    gain, error = compare(worse, better)
    return gain <= MIN_Z * error and not takes_all(worse, better)


def free_forms(model: Model, joint: int, rows: Rows) -> Term | None:
    """Return a term that lets the torque of what was found vary over position and velocity.

    None where nothing that adds torque was found at the joint.
    """
    recording = model.recording
    position, velocity = recording.position[:, joint], recording.velocity[:, joint]
    shares = np.concatenate([hat_basis(position, KNOTS), hat_basis(velocity, KNOTS)], axis=1)
    columns = [
        (kept_columns(term)[joint] @ own)[:, None] * shares
        for term, own in model.split(evaluate(model, rows).coefficients)
        if term.candidate is not None and joint in term.columns
    ]
    if not columns:
        return None
    both = np.concatenate(columns, axis=1)
    return Term(joint=joint, columns={joint: both}, kept=tuple(range(both.shape[1])))
