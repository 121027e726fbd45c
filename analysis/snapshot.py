"""What is known of a study at one moment, as JSON.

    {"study", "method", "seed", "cursor", "rows", "rows_complete", "rows_used", "level",
     "evaluations": {outcome: number},
     "outputs": {output: {"mean", "sd", "n",
                          "factors": {factor: {"n", index: {"value", "low", "high"}, ...}},
                          sum: {"value", "low", "high"}, ...}}}

Indices are "mu", "mu_star" and "sigma" (method morris, in the output's unit per range of the
factor) or "first_order" and "total_order" (method saltelli, shares of the variance), for which
there are the sums "sum_first_order" and "sum_total_order". What is not defined yet is null.
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from analysis.estimators import Estimate, Estimator, estimator_class
from analysis.records import StudyPlan

#: Of the confidence intervals (paper, figure 10).
LEVEL = 0.9


def take_snapshot(
    plan: StudyPlan,
    estimator: Estimator,
    *,
    cursor: int,
    rows_complete: int,
    evaluations: Mapping[str, int],
) -> dict[str, Any]:
    """Return the snapshot of a study (module docstring).

    Args:
        plan: the study.
        estimator: what was made of its complete rows.
        cursor: sequence number of the last result taken in.
        rows_complete: rows of which every result is in.
        evaluations: number of results by outcome.
    """
    indices = estimator.indices(LEVEL)
    of_factors = {name: index for name, index in indices.items() if index.value.ndim == 2}
    sums = {name: index for name, index in indices.items() if index.value.ndim == 1}
    moments, effects = estimator.moments(), estimator.effects
    return {
        "study": plan.id,
        "method": plan.method,
        "seed": plan.seed,
        "cursor": cursor,
        "rows": plan.rows,
        "rows_complete": rows_complete,
        "rows_used": estimator.rows_used,
        "level": LEVEL,
        "evaluations": dict(sorted(evaluations.items())),
        "outputs": {
            output: {
                "mean": _number(moments.mean[o]),
                "sd": _number(moments.sd[o]),
                "n": int(moments.n[o]),
                "factors": {
                    factor: {
                        **{name: _interval(index, (o, f)) for name, index in of_factors.items()},
                        "n": int(effects[o, f]),
                    }
                    for f, factor in enumerate(plan.factors)
                },
                **{name: _interval(index, (o,)) for name, index in sums.items()},
            }
            for o, output in enumerate(plan.outputs)
        },
    }


def empty_snapshot(plan: StudyPlan) -> dict[str, Any]:
    """Return the snapshot of a study that has no result yet."""
    return take_snapshot(plan, new_estimator(plan), cursor=0, rows_complete=0, evaluations={})


def new_estimator(plan: StudyPlan) -> Estimator:
    """Return the estimator of a study without results; ValueError if its method is unknown."""
    return estimator_class(plan.method)(
        sampling=plan.sampling,
        seed=plan.seed,
        factors=len(plan.factors),
        outputs=len(plan.outputs),
    )


def _interval(index: Estimate, at: tuple[int, ...]) -> dict[str, float | None]:
    return {
        "value": _number(index.value[at]),
        "low": _number(index.low[at]),
        "high": _number(index.high[at]),
    }


def _number(value: float) -> float | None:
    """Return a number that JSON has."""
    return float(value) if isfinite(value) else None
