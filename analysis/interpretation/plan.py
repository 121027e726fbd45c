"""What an interval is made of, and what to measure next: read from the bank, nothing is simulated.

Shares are relative weights (Johnson 2000, A heuristic method for estimating the relative weight of
predictor variables in multiple regression): they add up to what all factors together explain.
"""

from dataclasses import dataclass

import numpy as np

from analysis.interpretation.every_plan import every_plan
from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.posterior import TARGETS
from analysis.interpretation.inference.view import View

#: Most steps of which every set is looked at: 2^13 of them take half a second.
MOST = 13
#: The part of the variance that is left.
REST = "what no single factor explains"


@dataclass(frozen=True, kw_only=True)
class Step:
    """One thing to measure on the patient, or on the robot."""

    factor: str
    #: Standard deviation that is reached, and its unit ("1" of a share).
    to: float
    unit: str
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
    units = interpreter.population.units()
    return [
        Step(
            factor=name,
            to=measure.to,
            unit=units[name],
            minutes=measure.minutes,
            how=measure.how,
        )
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

    Every set of steps is looked at; of more than MOST steps, every set of those that narrow most by
    themselves, and all.

    Returns:
        None if no set reaches it.
    """
    alone = {s.factor: half_width_after(interpreter, view, known, (s,)) for s in offered}
    first = sorted(offered, key=lambda step: alone[step.factor])[:MOST]
    by_name = {step.factor: step for step in first}
    best: tuple[float, int, float, tuple[Step, ...]] | None = None
    for names, width in every_plan(interpreter, view, known, {s.factor: s.to for s in first}):
        done = tuple(by_name[name] for name in names)
        entry = (sum(step.minutes for step in done), len(done), width, done)
        if done and width <= tolerance and (best is None or entry[:3] < best[:3]):
            best = entry
    if best is not None:
        return best[3], best[2]
    width = half_width_after(interpreter, view, known, tuple(offered))
    return (tuple(offered), width) if offered and width <= tolerance else None
