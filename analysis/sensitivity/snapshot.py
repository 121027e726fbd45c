"""What is known of a study at one moment, as JSON: the paper, section 2.4, with intervals.

    {"study", "method", "seed", "cursor", "rows", "rows_complete", "rows_used", "level",
     "evaluations": {outcome: number},
     "outputs": {output: OUTPUT},
     "sampling",
     "curves": {output: CURVE},
     "failure": {"failed", "runs", "depends_on_factors", "caused_by": [factor],
                 "goes_with": [output], "detectable", "sentence",
                 **OUTPUT}}

    OUTPUT: {"mean", "sd", "n",
             "factors": {factor: {"n", "rests_on", index: {"value", "low", "high"}, ...,
                                  "worst_case": {index: {"value", "low", "high"}, ...},
                                  "martinez": {index: {"value", "low", "high"}, ...},
                                  "per_unit": {index: {"value", "low", "high"}, ...,
                                               "scale": {"width", "by"}}}},
             sum: {"value", "low", "high"}, ...,
             "second_order": [{"factors": [factor, factor], "value", "low", "high", "n"}],
             "surrogate": {"kind", "runs", "explained"},
             "trust": {"runs", "effective_runs", "unseen", "trusted", "sentence"},
             "ranking": {"by", "order": [factor], "same_order", "same_first"},
             "screening": {"by", "threshold", "dummy", "influential": [factor],
                           "non_influential": [factor], "undecided": [factor]},
             "convergence": {"rows": [number],
                             "factors": {factor: {index: {"value": [], "low": [], "high": []}}},
                             "second_order": [{"factors": [factor, factor], "value": [], ...}]}}

"curves", if the study has any, are described in `analysis.sensitivity.curves.findings`; their
points are no "outputs".

Indices are "mu", "mu_star" and "sigma" (method morris, in the output's unit per whole range of the
factor, so that factors can be compared; under "per_unit" the same per unit of the factor, divided
by the "width" of its distribution, `analysis.designs.distributions.Distribution.scale`) or
"first_order" and "total_order" (method saltelli, shares of the variance), for which there are the
sums "sum_first_order" and "sum_total_order" and the measure of chance "dummy_first_order"
(`SaltelliEstimator`). "interaction" is by how much the second of these exceeds the first,
"rests_on" the effective number of rows that make up "total_order"
(`analysis.sensitivity.estimators.tails`), "worst_case" between which bounds the indices lie
whatever the failed runs would have said (`judgement.worst_case`; null if none failed),
"martinez" both indices as correlations with Fisher's intervals
(`analysis.sensitivity.estimators.other_formulas`). "second_order", of method
saltelli_second_order only, is what a pair does beyond what each of the two does alone. "surrogate",
of method surrogate only, says what was fitted to how many runs, and what share of the variance it
explains of runs held out; indices and convergence are then those of
`analysis.sensitivity.fewer_runs.looks`. "failure" is
the indicator that is 1 where a run failed and 0 elsewhere (`judgement.failures`),
"trust" says whether the sample was enough for its intervals (`judgement.trust`),
"ranking" says how many bootstrap replicates rank the factors alike
(`judgement.ranking`), "screening" which factors surely do less or more than a threshold
(`judgement.screening`; "dummy" is what a factor of no influence has), "convergence" what
the first 8, 16, 32, ... rows said (`analysis.sensitivity.convergence`). What is not defined yet is
null.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from itertools import combinations
from types import MappingProxyType
from typing import Any

from analysis.designs import family
from analysis.json_values import number, plain
from analysis.sensitivity.convergence import GrowingEstimator, Point
from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.curves.findings import SIGNED, findings
from analysis.sensitivity.curves.points import looked_at
from analysis.sensitivity.estimators import (
    OF_PAIRS,
    Estimate,
    Estimator,
    Statistic,
    estimator_class,
    interaction,
)
from analysis.sensitivity.judgement.failures import judge
from analysis.sensitivity.judgement.ranking import RANKED_BY, Ranking, rank
from analysis.sensitivity.judgement.screening import influence
from analysis.sensitivity.judgement.trust import judge as judge_trust
from analysis.sensitivity.judgement.worst_case import worst_case
from analysis.sensitivity.records import StudyPlan
from models.curves import columns_of

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
    curves: Mapping[str, CurveEstimator] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the snapshot of a study (module docstring).

    Args:
        plan: the study.
        estimator: what was made of its complete rows, from `new_estimator`.
        series: what was made of growing parts of them.
        cursor: sequence number of the last result taken in.
        rows_complete: rows of which every result is in.
        evaluations: number of results by outcome.
        curves: what was made of the rows of each curve.
    """
    failed = sum(evaluations.values()) > evaluations.get("ok", 0)
    found = _Findings(plan, estimator, series, failed=failed)
    names = scalars(plan)
    failure = _failure(plan, estimator, found.statistics, evaluations)
    hidden = failure["depends_on_factors"] is True
    # Of every run it is known whether it failed.
    shown = [found.output(o, hidden=hidden and o < len(names)) for o in range(len(names) + 1)]
    used = [estimator.rows_used, *(curve.points.rows_used for curve in curves.values())]
    along = {
        name: findings(
            name,
            plan.curves[name],
            curve,
            list(plan.units),
            LEVEL,
            [unit for unit, members in plan.units.items() if len(members) > 1],
        )
        for name, curve in curves.items()
    }
    return {
        "study": plan.id,
        "method": plan.method,
        "seed": plan.seed,
        "cursor": cursor,
        "rows": plan.rows,
        "rows_complete": rows_complete,
        "rows_used": max(used),
        "level": LEVEL,
        "evaluations": dict(sorted(evaluations.items())),
        "outputs": dict(zip(names, shown, strict=False)),
        **({"curves": along} if along else {}),
        "sampling": plan.sampling,
        "failure": failure | shown[-1],
    }


def empty_snapshot(plan: StudyPlan) -> dict[str, Any]:
    """Return the snapshot of a study that has no result yet."""
    return take_snapshot(
        plan,
        new_estimator(plan),
        [],
        cursor=0,
        rows_complete=0,
        evaluations={},
        curves=new_curves(plan),
    )


def scalars(plan: StudyPlan) -> tuple[str, ...]:
    """Return the outputs that are no points of curves."""
    inside = set(columns_of(plan.curves, plan.curves))
    return tuple(output for output in plan.outputs if output not in inside)


def new_curves(plan: StudyPlan) -> dict[str, CurveEstimator]:
    """Return the estimators of a study's curves without results, by name."""
    factors = len(plan.units)
    return {
        name: CurveEstimator(
            method=plan.method,
            sampling=plan.sampling,
            seed=plan.seed,
            factors=factors,
            points=len(looked_at(curve.points, factors)),
        )
        for name, curve in plan.curves.items()
    }


def new_estimator(plan: StudyPlan) -> Estimator:
    """Return the estimator of a study without results; ValueError if its method is unknown.

    Its outputs are the study's without its curves and, last, the indicator of failure.
    """
    return estimator_class(plan.method)(
        sampling=plan.sampling,
        seed=plan.seed,
        factors=len(plan.units),
        outputs=len(scalars(plan)) + 1,
        indicators=1,
    )


def new_growing_estimator(plan: StudyPlan) -> GrowingEstimator:
    """Return a `new_estimator` that remembers what it said at powers of two."""
    return GrowingEstimator(lambda: new_estimator(plan), LEVEL)


class _Findings:
    """What was found of a study's outputs."""

    def __init__(
        self, plan: StudyPlan, estimator: Estimator, series: Sequence[Point], *, failed: bool
    ) -> None:
        self.statistics = estimator.statistics()
        self._estimator = estimator
        self._plan, self._series, self._names = plan, series, scalars(plan)
        self._indices = {name: found.estimate(LEVEL) for name, found in self.statistics.items()}
        #: What factors do in company only.
        self._interaction = None
        if family(plan.method) == "saltelli":
            first, total = (self.statistics[name] for name in ("first_order", "total_order"))
            self._interaction = interaction(first, total).estimate(LEVEL)
        self._worst = worst_case(estimator, self.statistics, LEVEL) if failed else None
        self._compared = estimator.compared(LEVEL)
        self._moments, self._effects = estimator.moments(), estimator.effects
        self._pairs = list(enumerate(combinations(plan.units, 2)))
        #: Names of the indices of pairs, of single factors and of whole outputs.
        self._of_pairs = [name for name in OF_PAIRS if name in self._indices]
        rest = {n: index for n, index in self._indices.items() if n not in OF_PAIRS}
        self._of_factors = [name for name, index in rest.items() if index.value.ndim == 2]
        self._of_outputs = [name for name, index in rest.items() if index.value.ndim == 1]

    def output(self, o: int, *, hidden: bool) -> dict[str, Any]:
        """Return OUTPUT of the module docstring; `hidden`: whether failures depend on factors."""
        plan, indices = self._plan, self._indices
        factors = {name: self._factor(name, (o, f)) for f, name in enumerate(plan.units)}
        by = RANKED_BY[family(plan.method)]
        ranking = rank(self.statistics[by].weighted[:, o], list(plan.units))
        unknown = dict.fromkeys(field.name for field in fields(Ranking))
        name = self._names[o] if o < len(self._names) else "failure"
        trust = judge_trust(self._estimator, self.statistics, o, name)
        return {
            "mean": number(self._moments.mean[o]),
            "sd": number(self._moments.sd[o]),
            "n": int(self._moments.n[o]),
            "factors": factors,
            **{name: _interval(indices[name], (o,)) for name in self._of_outputs},
            **{
                name: [
                    {
                        "factors": list(pair),
                        **_interval(indices[name], (o, p)),
                        "n": int(self.statistics[name].n[o, p]),
                    }
                    for p, pair in self._pairs
                ]
                for name in self._of_pairs
            },
            **({"surrogate": None} if plan.method == "surrogate" else {}),
            "trust": plain(trust),
            "ranking": {"by": by, **(unknown if ranking is None else plain(ranking))},
            "screening": plain(
                influence(factors, plan.method, trusted=trust.trusted is True, hidden=hidden)
            ),
            "convergence": {
                "rows": [point.rows for point in self._series],
                "factors": {
                    factor: {
                        name: self._curve(name, (o, f))
                        if len(members) == 1 or name not in SIGNED
                        else dict.fromkeys(("value", "low", "high"), [None] * len(self._series))
                        for name in self._of_factors
                    }
                    for f, (factor, members) in enumerate(plan.units.items())
                },
                **{
                    name: [
                        {"factors": list(pair), **self._curve(name, (o, p))}
                        for p, pair in self._pairs
                    ]
                    for name in self._of_pairs
                },
            },
        }

    def _factor(self, factor: str, at: tuple[int, int]) -> dict[str, Any]:
        found: dict[str, Any] = {n: _interval(self._indices[n], at) for n in self._of_factors}
        if len(self._plan.units[factor]) > 1:
            found |= {n: dict.fromkeys(found[n]) for n in found if n in SIGNED}
        if self._interaction is not None:
            found["interaction"] = _interval(self._interaction, at)
        # Shares have no unit, and effects do not rest on a few large squares.
        if self._plan.method == "morris":
            scale, found["per_unit"] = self._plan.scales.get(factor), None
            if scale is not None and scale.width != 0.0:
                found["per_unit"] = {
                    **{n: _interval(self._indices[n], at, scale.width) for n in self._of_factors},
                    "scale": asdict(scale),
                }
        total = self.statistics.get("total_order")
        if total is not None and total.tail is not None:
            found["rests_on"] = number(total.tail.rows[at])
        # Of every run it is known whether it failed.
        worst = self._worst if at[0] < len(self._names) else None
        found["worst_case"] = worst and {name: _interval(worst[name], at) for name in worst}
        for who, compared in self._compared.items():
            found[who] = {name: _interval(index, at) for name, index in compared.items()}
        return {**found, "n": int(self._effects[at])}

    def _curve(self, name: str, at: tuple[int, int]) -> dict[str, Any]:
        points = [_interval(point.indices[name], at) for point in self._series]
        return {end: [point[end] for point in points] for end in ("value", "low", "high")}


def _failure(
    plan: StudyPlan,
    estimator: Estimator,
    statistics: Mapping[str, Statistic],
    evaluations: Mapping[str, int],
) -> dict[str, Any]:
    runs = sum(evaluations.values())
    failed = runs - evaluations.get("ok", 0)
    names = scalars(plan)
    verdict = judge(
        estimator, statistics, len(names), list(plan.units), names, failed=failed, runs=runs
    )
    return {"failed": failed, "runs": runs, **plain(verdict)}


def _interval(index: Estimate, at: tuple[int, ...], width: float = 1.0) -> dict[str, float | None]:
    return {
        "value": number(index.value[at] / width),
        "low": number(index.low[at] / width),
        "high": number(index.high[at] / width),
    }
