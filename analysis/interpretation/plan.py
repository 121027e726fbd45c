"""What an interval is made of, and what to measure next: read from the bank, nothing is simulated.

Shares are relative weights (Johnson 2000, A heuristic method for estimating the relative weight of
predictor variables in multiple regression): they add up to what all factors together explain.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.posterior import TARGETS, View

#: Share of the wanted width that a plan keeps in hand when plans are compared.
MARGIN = 0.97
#: Most steps of a plan, unless it takes all.
MOST_STEPS = 5
#: The part of the variance that is left.
REST = "what no single factor explains"


@dataclass(frozen=True, kw_only=True)
class Step:
    """One thing to measure on the patient, or on the robot."""

    factor: str
    #: Standard deviation that is reached.
    to: float
    minutes: float
    how: str


def parts(interpreter: Interpreter, view: View, known: tuple[Known, ...]) -> dict[str, float]:
    """Return the share of each factor in the variance of K that is left, largest first.

    What is known to a standard deviation counts with what is left of it.
    """
    columns, sds = interpreter.measured(known)
    covariance = view.covariance
    if len(columns):
        own = covariance[np.ix_(columns, columns)] + np.diag(sds**2)
        across = covariance[:, columns]
        covariance = covariance - across @ np.linalg.solve(own, across.T)
    names = interpreter.population.names
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
    correlation = covariance / np.outer(spread, spread)
    factors = correlation[len(TARGETS) :, len(TARGETS) :]
    values, vectors = np.linalg.eigh(factors)
    root = vectors * np.sqrt(np.maximum(values, 1e-9)) @ vectors.T
    slopes = np.linalg.solve(root, correlation[len(TARGETS) :, 0])
    shares = root**2 @ slopes**2
    total = shares.sum()
    if total > 1.0:
        shares /= total
    found = dict(zip(names, shares.tolist(), strict=True))
    ordered = dict(sorted(found.items(), key=lambda item: -item[1]))
    return ordered | {REST: max(0.0, 1.0 - total)}


def steps(interpreter: Interpreter, known: tuple[Known, ...]) -> list[Step]:
    """Return everything that can be measured and is not known that well already."""
    measured = {one.name: one.sd for one in known}
    return [
        Step(factor=name, to=measure.to, minutes=measure.minutes, how=measure.how)
        for name, measure in interpreter.population.measures.items()
        if measured.get(name, np.inf) > measure.to
    ]


def half_width_after(
    interpreter: Interpreter, view: View, known: tuple[Known, ...], done: tuple[Step, ...]
) -> float:
    """Return the half width of K's 90 % interval to expect after some steps, Nm/rad."""
    again = {step.factor for step in done}
    kept = tuple(one for one in known if one.name not in again)
    return interpreter.after(view, kept, {step.factor: step.to for step in done}).half_width()


def shortest_plan(
    interpreter: Interpreter,
    view: View,
    known: tuple[Known, ...],
    offered: list[Step],
    tolerance: float,
) -> tuple[tuple[Step, ...], float] | None:
    """Return the steps of least time that bring K's half width below a tolerance, and that width.

    All sets of a few steps are compared by the Gaussian model; the least that promise enough are
    then looked at with calibrated widths.

    Returns:
        None if not even all steps together reach it.
    """
    kept = tuple(one for one in known if one.name not in {step.factor for step in offered})
    columns, sds = interpreter.measured(kept)
    more, scaled = interpreter.measurable(view, {step.factor: step.to for step in offered})
    now = interpreter.infer(view, kept)
    per_spread = now.half_width() / now.spread[0]
    found = []
    for count in range(1, min(len(offered), MOST_STEPS) + 1):
        for chosen in map(list, combinations(range(len(offered)), count)):
            every = np.concatenate([columns, more[chosen]])
            _, spread = view.corrected(
                every, np.zeros(len(every)), np.concatenate([sds, scaled[chosen]])
            )
            if spread[0] * per_spread <= tolerance / MARGIN:
                found.append((sum(offered[i].minutes for i in chosen), chosen))
    found.sort(key=lambda entry: (entry[0], len(entry[1])))
    everything = tuple(offered)
    candidates = [tuple(offered[i] for i in chosen) for _, chosen in found[:12]]
    for done in (*candidates, everything) if everything else ():
        width = half_width_after(interpreter, view, known, done)
        if width <= tolerance:
            return done, width
    return None
