"""Non-linear parameters of one joint's law, fitted together with all its coefficients.

A search that moves one at a time stops on the way along a ridge. Each step here fits the
coefficients anew (variable projection; Golub and Pereyra 2003, Separable nonlinear least squares:
the variable projection method and its applications).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from analysis.closeloop.identification.balance.least_squares import solve
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows
from sim.effects.effect import Theta

#: How far within its limits a search begins, in logarithms.
NEAR = 1e-3
#: Least and most of the speed at which an excess of friction is lost, over the top speed, and of
#: the power of that loss, with those that a search begins at.
SPEEDS, POWERS, BEGUN = (0.004, 1.0), (0.3, 4.0), (2.0, 1.0, 0.5)


def settled(
    others: Model,
    rows: Rows,
    columns: Callable[[Theta], np.ndarray],
    lower: Sequence[float],
    begun: Sequence[Theta],
    limits: Mapping[str, tuple[float, float]],
) -> Theta:
    """Return the non-linear parameters that fit the rows of one joint best.

    Args:
        others: what else acts at the joint.
        rows: of the joint alone.
        columns: of what is asked for, (n, k), by its parameters.
        lower: bounds of its k coefficients.
        begun: where the search begins; the best end is taken.
        limits: least and most of each parameter to fit, all above zero; others stay.
    """
    (joint,) = rows.joints
    base, base_lower = others.base(rows)
    target = others.target(rows)
    bounds = np.concatenate([base_lower, lower])
    low, high = np.log(list(limits.values())).T

    def at(theta: Theta) -> np.ndarray:
        return np.clip(np.log([theta[name] for name in limits]), low + NEAR, high - NEAR)

    def theta_of(at: np.ndarray, start: Theta) -> Theta:
        return {**start, **dict(zip(limits, np.exp(at).tolist(), strict=True))}

    def left(at: np.ndarray, start: Theta) -> np.ndarray:
        own = columns(theta_of(at, start))
        own = rows.stack(others.transformed({joint: own}), own.shape[1])
        table = np.column_stack([base, own, target])
        return np.asarray(target - table[:, :-1] @ solve(table.T @ table, bounds))

    found = [
        (
            least_squares(
                left, at(start), args=(start,), bounds=(low, high), diff_step=1e-3, ftol=1e-6
            ),
            start,
        )
        for start in begun
    ]
    best, start = min(found, key=lambda pair: float(pair[0].cost))
    return theta_of(best.x, start)
