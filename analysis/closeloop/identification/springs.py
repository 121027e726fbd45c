"""Parameters of springs between motors and what hangs on them, all at once."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import least_squares

from analysis.closeloop.identification.balance.luck import MIN_GAIN
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Theta
from sim.effects.laws.loose_link import AGREES, BEHIND, RESONANCES, springs_together
from sim.effects.motion import RecordedJoint

ELASTIC = BY_NAME["series_elasticity"]
#: Steps of all springs' parameters at once, at most; the share of what is left that one has to take
#: away for another to follow, and by what share a parameter is moved to see what it does.
STEPS, SETTLED, STEP = 15, 1e-3, 0.01
#: Directions of what else is fitted that are so much weaker than the strongest are not told.
TOLD = 1e-6
#: How far a parameter may go, as a factor, and the least damping ratio that it begins from.
FURTHEST, LEAST_DAMPING = 8.0, 0.005
#: Damping ratio, and shares of the inertia, with which a search of a limb's spring begins.
#: (Set while looking at five of an opponent's limbs.)
BEGIN_DAMPING, BEGIN_BEHIND = 0.05, (1.0, 0.3)


def left_by(
    rest: Model,
    rows: Rows,
    joint: RecordedJoint,
    beside: np.ndarray | None = None,
    *,
    agrees: float = AGREES,
) -> Callable[[Mapping[int, Theta]], np.ndarray]:
    """Return what tells what springs leave, (r,), of given parameters by their joints.

    Args:
        rest: a model that has none; its terms are fitted anew beside each.
        rows: the samples that are fitted.
        joint: one of those with a spring, with the estimate that the springs carry.
        beside: further columns that are fitted beside them, (r, k).
        agrees: factor by which their compliance and that of their resonance may differ.
    """
    base, _ = rest.base(rows)
    if beside is not None:
        base = np.column_stack([base, beside])
    scale = np.linalg.norm(base, axis=0).clip(1e-300)
    others, size, _ = np.linalg.svd(base / scale, full_matrices=False)
    others = others[:, size > TOLD * size.max(initial=0.0)]
    target = rest.target(rows)
    target = target - others @ (others.T @ target)

    def left(thetas: Mapping[int, Theta]) -> np.ndarray:
        columns = rest.transformed(springs_together(joint, thetas))
        own = rows.stack(columns, 1)[:, 0]
        own = own - others @ (others.T @ own)
        size = float(own @ target) / max(float(own @ own), 1e-300)
        return np.asarray(target - np.clip(size, 1.0 / agrees, agrees) * own)

    return left


def nearest(
    left: Callable[[Mapping[int, Theta]], np.ndarray], thetas: Mapping[int, Theta]
) -> dict[int, Theta]:
    """Return the parameters of springs, all at once, that leave least near where they are.

    By Levenberg and Marquardt's method over their logarithms.
    """
    names = [(number, name) for number, theta in thetas.items() for name in theta]
    begin = np.log([max(thetas[number][name], LEAST_DAMPING) for number, name in names])
    most = np.log([ELASTIC.parameters[name].ceiling for _, name in names])
    low, high = begin - np.log(FURTHEST), np.minimum(begin + np.log(FURTHEST), most)
    begin = np.minimum(begin, high - STEP)

    def at(logarithms: np.ndarray) -> dict[int, Theta]:
        found: dict[int, dict[str, float]] = {number: {} for number in thetas}
        for (number, name), value in zip(names, np.exp(logarithms).tolist(), strict=True):
            found[number][name] = value
        return dict(found)

    found = least_squares(
        lambda x: left(at(x)),
        begin,
        bounds=(low, high),
        diff_step=STEP,
        ftol=SETTLED,
        max_nfev=STEPS,
    )
    return at(found.x)


def of_limb(rest: Model, rows: Rows, joint: RecordedJoint) -> list[Theta]:
    """Return where a search for a limb's spring ends from the best points of a grid; or nothing.

    A link that swings with little damping is soon out of step on a spring that is an eighth too
    stiff: then no point of a grid has the size that its resonance says. (An opponent's.)

    Args:
        rest: a model that has none.
        rows: the samples that are fitted.
        joint: the limb's, with the estimate that the spring carries.
    """
    left, number = left_by(rest, rows, joint, agrees=1.0), joint.number
    least = (1.0 - MIN_GAIN) * evaluate(rest, rows).sse
    ends = []
    for behind in BEGIN_BEHIND:
        grid = [
            {number: {"resonance": hertz, "damping_ratio": BEGIN_DAMPING, BEHIND: behind}}
            for hertz in RESONANCES
        ]
        begin = min(grid, key=lambda thetas: float(np.sum(left(thetas) ** 2)))
        if float(np.sum(left(begin) ** 2)) < least:
            ends.append(nearest(left, begin)[number])
    return ends
