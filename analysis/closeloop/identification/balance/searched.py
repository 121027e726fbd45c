"""Non-linear parameters of an effect, several at once."""

import numpy as np
from scipy.optimize import least_squares

from analysis.closeloop.identification.balance.least_squares import beyond
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate
from sim.effects.effect import Limits, Theta
from sim.effects.motion import RecordedJoint

#: Share of its range by which a parameter is moved to see what it does; steps at most, and the
#: share of what is left that one has to take away for another to follow.
STEP, STEPS, SETTLED = 0.005, 20, 1e-4


def searched(
    rest: Model, rows: Rows, candidate: Candidate, joint: RecordedJoint, begin: Theta, free: Limits
) -> Theta:
    """Return the parameters of an effect that leave least near where they are.

    By the Trust Region Reflective method (Branch, Coleman and Li 1999), the columns' sizes being
    fitted beside every model (Golub and Pereyra 1973, variable projection).

    Args:
        rest: the model without the effect.
        rows: the samples that are fitted.
        candidate: the effect.
        joint: its joint.
        begin: parameters that the search begins with.
        free: those that may change, each with the values between which it may.
    """
    base, _ = rest.base(rows)
    left_of = beyond(base)
    target, names = left_of(rest.target(rows)), list(free)
    low, high = np.array([free[name] for name in names]).T
    bounds = [candidate.effect.bound(n) for n in range(len(candidate.effect.coefficients))]

    def at(x: np.ndarray) -> Theta:
        values = low + (x - 1.0) * (high - low)
        return {**begin, **dict(zip(names, values.tolist(), strict=True))}

    def left(x: np.ndarray) -> np.ndarray:
        columns = candidate.effect.columns(joint, at(x))
        own = left_of(rows.stack(rest.transformed(columns), len(bounds)))
        sizes = np.maximum(np.linalg.lstsq(own, target)[0], bounds)
        return np.asarray(target - own @ sizes)

    place = 1.0 + (np.array([begin[name] for name in names]) - low) / (high - low)
    found = least_squares(
        left,
        np.clip(place, 1.0 + STEP, 2.0 - STEP),
        bounds=(1.0, 2.0),
        diff_step=STEP,
        ftol=SETTLED,
        max_nfev=STEPS,
    )
    return at(found.x)
