"""What is known of a study at one moment, as JSON: the paper, section 2.4, with intervals.

    {"study", "method", "seed", "cursor", "rows", "rows_complete", "rows_used", "level",
     "evaluations": {outcome: number},
     "outputs": {output: OUTPUT},
     "sampling",
     "failure": {"failed", "runs", "depends_on_factors", "caused_by": [factor], "sentence",
                 **OUTPUT}}

    OUTPUT: {"mean", "sd", "n",
             "factors": {factor: {"n", "rests_on", index: {"value", "low", "high"}, ...,
                                  "martinez": {index: {"value", "low", "high"}, ...},
                                  "per_unit": {index: {"value", "low", "high"}, ...,
                                               "scale": {"width", "by"}}}},
             sum: {"value", "low", "high"}, ...,
             "second_order": [{"factors": [factor, factor], "value", "low", "high", "n"}],
             "ranking": {"by", "order": [factor], "same_order", "same_first"},
             "screening": {"by", "threshold", "dummy", "influential": [factor],
                           "non_influential": [factor], "undecided": [factor]},
             "convergence": {"rows": [number],
                             "factors": {factor: {index: {"value": [], "low": [], "high": []}}},
                             "second_order": [{"factors": [factor, factor], "value": [], ...}]}}

Indices are "mu", "mu_star" and "sigma" (method morris, in the output's unit per whole range of the
factor, so that factors can be compared; under "per_unit" the same per unit of the factor, divided
by the "width" of its distribution, `analysis.designs.distributions.Distribution.scale`) or
"first_order" and "total_order" (method saltelli, shares of the variance), for which there are the
sums "sum_first_order" and "sum_total_order" and the measure of chance "dummy_first_order"
(`SaltelliEstimator`). "rests_on" is the effective number of rows that make up "total_order"
(`analysis.sensitivity.estimators.tails`), "martinez" both indices as correlations with Fisher's
intervals (`analysis.sensitivity.estimators.martinez`). "second_order", of method
saltelli_second_order only, is what a pair does beyond what each of the two does alone. "failure" is
the indicator that is 1 where a run failed and 0 elsewhere (`analysis.sensitivity.failures`),
"ranking" says how many bootstrap replicates rank the factors alike
(`analysis.sensitivity.ranking`), "screening" which factors surely do less or more than a threshold
(`analysis.sensitivity.screening`; "dummy" is what a factor of no influence has), "convergence" what
the first 8, 16, 32, ... rows said (`analysis.sensitivity.convergence`). What is not defined yet is
null.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from itertools import combinations
from math import isfinite
from typing import Any

from analysis.designs import family
from analysis.sensitivity.convergence import GrowingEstimator, Point
from analysis.sensitivity.estimators import (
    OF_PAIRS,
    Estimate,
    Estimator,
    Statistic,
    estimator_class,
)
from analysis.sensitivity.failures import judge
from analysis.sensitivity.ranking import RANKED_BY, Ranking, rank
from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.screening import influence

#: Of the confidence intervals (paper, figure 10).
LEVEL = 0.9


def take_snapshot(
    plan: StudyPlan,
    estimator: Estimator,
    series: Sequence[Point],
    *,
    cursor: int,
    rows_complete: int,
    evaluations: Mapping[str, int],
) -> dict[str, Any]:
    """Return the snapshot of a study (module docstring).

    Args:
        plan: the study.
        estimator: what was made of its complete rows, from `new_estimator`.
        series: what was made of growing parts of them.
        cursor: sequence number of the last result taken in.
        rows_complete: rows of which every result is in.
        evaluations: number of results by outcome.
    """
    statistics = estimator.statistics()
    indices = {name: statistic.estimate(LEVEL) for name, statistic in statistics.items()}
    compared = estimator.compared(LEVEL)
    shown = [
        _output(plan, estimator, o, statistics, indices, compared, series)
        for o in range(len(plan.outputs) + 1)
    ]
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
        "outputs": dict(zip(plan.outputs, shown, strict=False)),
        "sampling": plan.sampling,
        "failure": _failure(plan, estimator, evaluations) | shown[-1],
    }


def empty_snapshot(plan: StudyPlan) -> dict[str, Any]:
    """Return the snapshot of a study that has no result yet."""
    return take_snapshot(plan, new_estimator(plan), [], cursor=0, rows_complete=0, evaluations={})


def new_estimator(plan: StudyPlan) -> Estimator:
    """Return the estimator of a study without results; ValueError if its method is unknown.

    Its outputs are the study's and, last, the indicator of failure.
    """
    return estimator_class(plan.method)(
        sampling=plan.sampling,
        seed=plan.seed,
        factors=len(plan.factors),
        outputs=len(plan.outputs) + 1,
        indicators=1,
    )


def new_growing_estimator(plan: StudyPlan) -> GrowingEstimator:
    """Return a `new_estimator` that remembers what it said at powers of two."""
    return GrowingEstimator(lambda: new_estimator(plan), LEVEL)


def _output(
    plan: StudyPlan,
    estimator: Estimator,
    o: int,
    statistics: Mapping[str, Statistic],
    indices: Mapping[str, Estimate],
    compared: Mapping[str, Mapping[str, Estimate]],
    series: Sequence[Point],
) -> dict[str, Any]:
    """Return OUTPUT of the module docstring."""
    moments, effects = estimator.moments(), estimator.effects
    of_factors = {
        name: index
        for name, index in indices.items()
        if index.value.ndim == 2 and name not in OF_PAIRS
    }
    sums = {name: index for name, index in indices.items() if index.value.ndim == 1}
    factors = {
        factor: {
            **{name: _interval(index, (o, f)) for name, index in of_factors.items()},
            **_per_unit(plan, factor, of_factors, (o, f)),
            **_rests_on(statistics, (o, f)),
            **{
                who: {name: _interval(index, (o, f)) for name, index in found.items()}
                for who, found in compared.items()
            },
            "n": int(effects[o, f]),
        }
        for f, factor in enumerate(plan.factors)
    }
    return {
        "mean": _number(moments.mean[o]),
        "sd": _number(moments.sd[o]),
        "n": int(moments.n[o]),
        "factors": factors,
        **{name: _interval(index, (o,)) for name, index in sums.items()},
        **_pairs(plan, statistics, indices, o),
        "ranking": _ranking(plan, statistics, o),
        "screening": _plain(influence(factors, plan.method)),
        "convergence": {
            "rows": [point.rows for point in series],
            "factors": {
                factor: {name: _curve(series, name, (o, f)) for name in of_factors}
                for f, factor in enumerate(plan.factors)
            },
            **{
                name: [
                    {"factors": list(pair), **_curve(series, name, (o, p))}
                    for p, pair in enumerate(combinations(plan.factors, 2))
                ]
                for name in OF_PAIRS
                if name in indices
            },
        },
    }


def _per_unit(
    plan: StudyPlan, factor: str, of_factors: Mapping[str, Estimate], at: tuple[int, int]
) -> dict[str, Any]:
    """Return {"per_unit": ...} of the module docstring; nothing for shares, which have no unit."""
    if plan.method != "morris":
        return {}
    scale = plan.scales.get(factor)
    if scale is None or scale.width == 0.0:
        return {"per_unit": None}
    found = {name: _interval(index, at, scale.width) for name, index in of_factors.items()}
    return {"per_unit": {**found, "scale": asdict(scale)}}


def _rests_on(statistics: Mapping[str, Statistic], at: tuple[int, int]) -> dict[str, Any]:
    """Return {"rests_on": ...} of the module docstring; nothing for elementary effects."""
    total = statistics.get("total_order")
    if total is None or total.tail is None:
        return {}
    return {"rests_on": _number(total.tail.rows[at])}


def _pairs(
    plan: StudyPlan, statistics: Mapping[str, Statistic], indices: Mapping[str, Estimate], o: int
) -> dict[str, Any]:
    """Return {"second_order": ...} of the module docstring; nothing if the design has none."""
    return {
        name: [
            {
                "factors": list(pair),
                **_interval(indices[name], (o, p)),
                "n": int(statistics[name].n[o, p]),
            }
            for p, pair in enumerate(combinations(plan.factors, 2))
        ]
        for name in OF_PAIRS
        if name in indices
    }


def _ranking(plan: StudyPlan, statistics: Mapping[str, Statistic], o: int) -> dict[str, Any]:
    by = RANKED_BY[family(plan.method)]
    ranking = rank(statistics[by].weighted[:, o], plan.factors)
    unknown = dict.fromkeys(field.name for field in fields(Ranking))
    return {"by": by, **(unknown if ranking is None else _plain(ranking))}


def _plain(record: Any) -> dict[str, Any]:
    """Return the fields of a record, tuples as the lists that JSON has."""
    found = asdict(record)
    return {name: list(v) if isinstance(v, tuple) else v for name, v in found.items()}


def _failure(
    plan: StudyPlan, estimator: Estimator, evaluations: Mapping[str, int]
) -> dict[str, Any]:
    runs = sum(evaluations.values())
    failed = runs - evaluations.get("ok", 0)
    verdict = judge(estimator, len(plan.outputs), plan.factors, failed=failed, runs=runs)
    return {"failed": failed, "runs": runs, **_plain(verdict)}


def _curve(series: Sequence[Point], name: str, at: tuple[int, ...]) -> dict[str, Any]:
    points = [_interval(point.indices[name], at) for point in series]
    return {end: [point[end] for point in points] for end in ("value", "low", "high")}


def _interval(index: Estimate, at: tuple[int, ...], width: float = 1.0) -> dict[str, float | None]:
    return {
        "value": _number(index.value[at] / width),
        "low": _number(index.low[at] / width),
        "high": _number(index.high[at] / width),
    }


def _number(value: float) -> float | None:
    """Return a number that JSON has."""
    return float(value) if isfinite(value) else None
