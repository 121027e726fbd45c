"""What is known of one curve at one moment, as JSON: an entry of "curves" in a snapshot.

    {"points", "over", "axis_unit", "axis": [], "looked_at": [], "mean": [], "sd": [], "n",
     "factors": {factor: {index: LINE}},
     "second_order": [{"factors": [factor, factor], **LINE}],
     "whole": {"factors": {factor: {index: {"value", "low", "high"}, "n", "rests_on"}},
               "sum_first_order", "sum_total_order",
               "second_order": [{"factors": [factor, factor], "value", "low", "high", "n"}]},
     "components": [{"share": {"value", "low", "high"}, "shape": [],
                     "factors": {factor: {index: {"value", "low", "high"}}}}],
     "held", "ranking", "screening", "trust", "on_few_runs": []}

    LINE: {"value": [], "low": [], "high": [], "band_low": [], "band_high": []}

Lists have a number for each of the points "looked_at" (`analysis.sensitivity.curves.points`), whose
places are "axis". Every interval holds its own point as often as the snapshot's level says, from
"low" to "high", and a band all points of an index at once (`analysis.sensitivity.curves.bands`).
"whole" has the generalised indices (`analysis.sensitivity.curves.whole`), "components" the
principal components, of which the curve's coefficients hold the share "held"
(`analysis.sensitivity.curves.components`). "ranking" and "screening" are those of the whole curve,
"trust" that of the point with the largest variance. "on_few_runs" are the places on the axis where
intervals and bands may not hold, since few runs make up the variance there. What is not defined is
null.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import family
from analysis.json_values import number, plain
from analysis.sensitivity.curves.bands import band_level, least_half
from analysis.sensitivity.curves.components import components
from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.curves.points import looked_at
from analysis.sensitivity.curves.whole import generalised
from analysis.sensitivity.estimators import OF_PAIRS, Estimate, Statistic
from analysis.sensitivity.judgement.ranking import RANKED_BY, rank
from analysis.sensitivity.judgement.screening import influence
from analysis.sensitivity.judgement.trust import FEWEST_ROWS, judge, on_few_runs
from models.curves import Curve

#: Some factors of a group go up where others go down: of its effects these mean nothing.
SIGNED = ("mu", "sigma")


def findings(
    name: str,
    curve: Curve,
    estimator: CurveEstimator,
    factors: Sequence[str],
    level: float,
    groups: Collection[str] = (),
) -> dict[str, Any]:
    """Return what is known of a curve (module docstring).

    Args:
        name: of the output.
        curve: its axis.
        estimator: of the study.
        factors: their names.
        level: of intervals and bands.
        groups: which of the factors are several that move together; effects of these have no sign.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    points = estimator.points
    statistics = points.statistics()
    moments = points.moments()
    at = looked_at(curve.points, len(factors))
    axis = np.array(curve.axis())[at]
    of_factors = [n for n, found in statistics.items() if found.n.ndim == 2 and n not in OF_PAIRS]
    lines = {n: _lines(statistics[n], level) for n in of_factors}
    of_pairs = {n: _lines(statistics[n], level) for n in OF_PAIRS if n in statistics}
    pairs = [list(pair) for pair in combinations(factors, 2)]
    # Of the sample: what its parts are shares of.
    variance = moments.sd**2 * (1.0 - 1.0 / np.maximum(moments.n, 1))
    of_whole = generalised(estimator, statistics)
    whole = _whole(of_whole, factors, pairs, level)
    by = RANKED_BY[family(points.method)]
    ranking = rank(of_whole[by].weighted, factors)
    leading = components(estimator, float(np.nansum(variance)), level)
    known = np.where(np.isfinite(variance), variance, -1.0)
    trust = judge(points, statistics, int(np.argmax(known)), name)
    enough = int(points.effects.max(initial=0)) >= FEWEST_ROWS
    screening = influence(whole["factors"], points.method, trusted=trust.trusted is True)

    def _signed(index: str, factor: str) -> bool:
        """Say whether an index needs a sign that the effects of a group have not."""
        return factor in groups and index in SIGNED

    return {
        "points": curve.points,
        "over": curve.over,
        "axis_unit": curve.unit,
        "axis": axis.tolist(),
        "looked_at": at.tolist(),
        "mean": _numbers(moments.mean),
        "sd": _numbers(moments.sd),
        "n": int(moments.n.max(initial=0)),
        "factors": {
            factor: {
                index: _unsaid(lines[index][f]) if _signed(index, factor) else lines[index][f]
                for index in of_factors
            }
            for f, factor in enumerate(factors)
        },
        **{
            index: [{"factors": pair, **of_pairs[index][p]} for p, pair in enumerate(pairs)]
            for index in of_pairs
        },
        "whole": whole,
        "components": [
            {
                "share": _interval(one.share, ()),
                "shape": _numbers(one.shape),
                "factors": {
                    factor: {
                        index: dict.fromkeys(("value", "low", "high"))
                        if _signed(index, factor)
                        else _interval(found, (f,))
                        for index, found in one.indices.items()
                    }
                    for f, factor in enumerate(factors)
                },
            }
            for one in leading.leading
        ],
        "held": number(leading.held),
        "ranking": {"by": by, **(_EMPTY if ranking is None else plain(ranking))},
        "screening": plain(screening),
        "trust": plain(trust),
        "on_few_runs": axis[on_few_runs(points)].tolist() if enough else [],
    }


def _unsaid(line: Mapping[str, Sequence[float | None]]) -> dict[str, list[None]]:
    """Return a line of an index that is not defined anywhere."""
    return {end: [None] * len(values) for end, values in line.items()}


_EMPTY = {"order": None, "same_order": None, "same_first": None}


def _whole(
    found: Mapping[str, Statistic], factors: Sequence[str], pairs: list[list[str]], level: float
) -> dict[str, Any]:
    indices = {name: statistic.estimate(level) for name, statistic in found.items()}
    sums = [name for name in found if name.startswith("sum_")]
    single = [name for name in found if name not in sums and name not in OF_PAIRS]
    tail = found["total_order"].tail if "total_order" in found else None
    return {
        "factors": {
            factor: {
                **{name: _interval(indices[name], (f,)) for name in single},
                "n": int(found[single[0]].n[f]),
                **({} if tail is None else {"rests_on": number(tail.rows[f])}),
            }
            for f, factor in enumerate(factors)
        },
        **{name: _interval(indices[name], (0,)) for name in sums},
        **{
            name: [
                {"factors": pair, **_interval(indices[name], (p,)), "n": int(found[name].n[p])}
                for p, pair in enumerate(pairs)
            ]
            for name in OF_PAIRS
            if name in found
        },
    }


def _lines(found: Statistic, level: float) -> list[dict[str, Any]]:
    """Return an index of every factor, or pair, along the curve, with intervals and band."""
    inside = found.estimate(level)
    lines = []
    for f in range(found.n.shape[-1]):
        one = _only(found, f)
        blocks = one.without[..., 0], one.present[..., 0]
        single = band_level(*blocks, level)
        band = one.estimate(single)
        value, bottom, top = band.value[:, 0], band.low[:, 0], band.high[:, 0]
        half = least_half(*blocks, one.weighted[1:, :, 0], single)
        # `minimum` and `maximum` keep what is unknown.
        bottom, top = np.minimum(bottom, value - half), np.maximum(top, value + half)
        if found.power is not None:
            bottom = np.maximum(bottom, 0.0)
        if found.whole is not None:
            # No share is truly above 1 (Sobol 1993), whatever few rows cannot rule out.
            top = np.minimum(top, np.maximum(inside.high[:, f], 1.0))
        lines.append(
            {
                "value": _numbers(inside.value[:, f]),
                "low": _numbers(inside.low[:, f]),
                "high": _numbers(inside.high[:, f]),
                "band_low": _numbers(bottom),
                "band_high": _numbers(top),
            }
        )
    return lines


def _only(found: Statistic, f: int) -> Statistic:
    """Return an index of one factor, whose axis stays."""

    def of_one(values: NDArray[Any]) -> NDArray[Any]:
        return values if values.shape[-1] == 1 else values[..., f : f + 1]

    return replace(
        found,
        weighted=of_one(found.weighted),
        n=of_one(found.n),
        without=of_one(found.without),
        present=of_one(found.present),
        tail=None
        if found.tail is None
        else replace(found.tail, stretch=of_one(found.tail.stretch), rows=of_one(found.tail.rows)),
        whole=None if found.whole is None else of_one(found.whole),
        apart=None if found.apart is None else of_one(found.apart),
        scale=None if found.scale is None else of_one(found.scale),
        longer=None if found.longer is None else of_one(found.longer),
    )


def _interval(index: Estimate, at: tuple[int, ...]) -> dict[str, float | None]:
    return {end: number(getattr(index, end)[at]) for end in ("value", "low", "high")}


def _numbers(values: NDArray[np.float64]) -> list[float | None]:
    return [number(value) for value in values.tolist()]
