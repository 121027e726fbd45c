"""What was found, free to move while another effect is tried beside it.

Where a first effect was fitted alone, its non-linear parameters have taken over some of what the
second does: a load hangs in another place. So they are free to first order while a second one is
tried, by the slope of the prediction over each (Gauss-Newton, as for intervals), and each is chosen
once more when it is there (backfitting; Friedman and Stuetzle 1981, Projection pursuit regression).
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import Model, with_independent
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.identification.balance.uncertainty import slopes_of
from sim.effects.effect import Effect


def freed(
    model: Model, coefficients: np.ndarray, rows: Rows, least: float = Effect.least_own
) -> Model:
    """Return the model with the non-linear parameters of its effects free to first order.

    Args:
        model: with effects that were found.
        coefficients: its fit.
        rows: the samples that are fitted.
        least: share of the power of what a parameter does that the model has to leave.
    """
    found = model
    for part, _, slope in slopes_of(model, coefficients):
        if part.candidate is None:
            # Of declared effects they are chosen again (`declared_again`).
            continue
        columns = {joint: slope[:, [joint]] for joint in rows.joints}
        term = Term(joint=part.candidate.joint, columns=columns)
        found = with_independent(found, term, rows, least)
    return found


def held(model: Model, before: Model) -> Model:
    """Return a model, found beside a freed one, without what was free.

    Args:
        model: with one effect more, or another.
        before: what was freed.
    """
    own = {id(term) for term in before.terms}
    terms = tuple(t for t in model.terms if id(t) in own or t.candidate is not None)
    return replace(model, terms=terms)
