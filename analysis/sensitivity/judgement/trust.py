"""Whether a sample was enough to be believed: what it rests on, and what it cannot have seen.

A variance is a mean of squares. If the output has a heavy tail, few runs make that mean up, and
with it every share of it; a sample that lacks them looks precise. The kurtosis k of the output
tells: n runs determine its variance as well as 2 n / k runs of equal squares would (Kish 1965,
Survey sampling, section 11.7). What no run shows at all nothing can tell: an event that strikes
less often than once in n / 3 runs is missed by n runs once in twenty times or more (the rule of
three: Hanley and Lippman-Hand 1983, If nothing goes wrong, is everything all right?).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators import Estimator, Statistic
from analysis.sensitivity.estimators.morris import ROUNDING
from analysis.sensitivity.fewer_runs.limits import ROUNDING as SAME
from analysis.sensitivity.records import LARGEST_OUTPUT

#: With fewer rows nothing is "reached" or "not influential".
FEWEST_ROWS = 128

#: A factor that moved nothing at all is "not influential" from here on: an event in 0.015 of the
#: cube is missed by 128 rows in 2 of 100 studies, by 256 rows in none of 400.
FEWEST_STILL_ROWS = 256

#: By chance a sample's kurtosis is twice its own: a tail has this, too, of what
#: `Estimator.other_kurtosis` looks at. That of normal values is 3, of exponential ones 9.
HEAVY = 6.0
#: A tail is seen well enough from so many effective runs on. With 200, studies of a Pareto tail
#: stopped where they had not seen it.
ENOUGH_RUNS = 500.0

#: Of the interval of the sum of total-order indices, which is never below 1, and of a share, which
#: is never above 1: a linear function, of which it is 1, is then taken to task in 1 study of 200.
_SURE_LEVEL = 0.99
#: What is above 1 by less would be said to be "at least 1".
CLEARLY_ABOVE_ONE = 1.005
#: Outputs that differ by less have squares, and powers of these, that are no numbers.
_SMALLEST_SPREAD = 1.0 / LARGEST_OUTPUT
#: What rounding may hide of effects, as a share of what the output varies by: half of what a factor
#: does that does not matter (`screening.SHARE_OF_LARGEST`).
_HIDDEN = 0.05
#: What is wrong with indices from trajectories that lie far apart (docs/decisions/0015).
_OUTER_LEVELS = (
    "sampling trajectories takes outer levels more often than inner ones, so indices of factors "
    "that interact are not those of the distributions that were asked for, and those of sampling "
    "random_trajectories are"
)
_SHARES = {"first_order": "a first-order index", "total_order": "a total-order index"}


@dataclass(frozen=True, kw_only=True)
class Trust:
    """How far the intervals of one output's indices can be trusted."""

    #: Runs that stand for the factors' distributions independently of each other.
    runs: int
    #: How many runs of equal squares would determine the variance as well; None if unknown.
    effective_runs: float | None
    #: What happens in less than this share of the runs may be unseen.
    unseen: float | None
    #: None with fewer than `FEWEST_ROWS` rows.
    trusted: bool | None
    #: Why they are not, or not yet; empty if they are.
    sentence: str


def on_few_runs(estimator: Estimator) -> NDArray[np.bool_]:
    """Return which outputs' variance, or largest effects, few runs make up (Kish 1965).

    Shape (outputs,).
    """
    kurtosis = estimator.kurtosis()
    with np.errstate(invalid="ignore"):
        few = kurtosis > estimator.heavy_kurtosis
        few &= estimator.independent_runs() / kurtosis < ENOUGH_RUNS
        # Nothing speaks against a tail where the other is unknown (nan), or has no such powers.
        light = (estimator.other_kurtosis() <= HEAVY) & np.isfinite(kurtosis)
    found: NDArray[np.bool_] = few & ~light
    return found


def judge(
    estimator: Estimator, statistics: Mapping[str, Statistic], output: int, name: str
) -> Trust:
    """Say how far an output's indices can be trusted (Kish 1965; Hanley and Lippman-Hand 1983).

    Args:
        estimator: of the study.
        statistics: of the estimator.
        output: which of its outputs.
        name: of the output, for the sentence.
    """
    rows = int(estimator.effects[output].max(initial=0))
    runs = int(estimator.independent_runs()[output])
    kurtosis = float(estimator.kurtosis()[output])
    effective = runs / kurtosis
    reasons = [_OUTER_LEVELS] if estimator.sampling == "trajectories" and rows else []
    reasons += not_in_numbers(name, float(estimator.least[output]), float(estimator.most[output]))
    if rows >= FEWEST_ROWS:
        if on_few_runs(estimator)[output]:
            as_many = f"as many as {effective:.0f} of equal size would, of {runs:,}"
            if estimator.method == "morris":
                reasons.append(
                    f"the largest effects on {name} rest on few rows ({as_many}), so sigma and the "
                    "means may be far off"
                )
            else:
                reasons.append(
                    f"the variance of {name} rests on few runs ({as_many}), so shares of it may be "
                    "far off, those of light factors too large"
                )
        short = _short_of_one(statistics, output)
        if short is not None:
            reasons.append(
                f"the total-order indices of {name} sum to at most {short:.2f}, and truly never to "
                "less than 1, so something that matters was seen too rarely"
            )
        for index, share in _SHARES.items():
            least = _above_one(statistics, index, output)
            if least is not None:
                reasons.append(
                    f"{share} of {name} is at least {least:.3g}, and truly never more than 1, so "
                    "the rows are too few for a share of the variance"
                )
    said = [f"Do not trust these intervals: {'; '.join(reasons)}."] if reasons else []
    if 0 < rows < FEWEST_ROWS:
        said.insert(0, f"Intervals of fewer than {FEWEST_ROWS} rows are not to be believed yet.")
    return Trust(
        runs=runs,
        effective_runs=effective if isfinite(effective) else None,
        unseen=3.0 / runs if runs >= 3 else None,
        trusted=None if rows < FEWEST_ROWS else not reasons,
        sentence=" ".join(said),
    )


def not_in_numbers(name: str, least: float, most: float) -> list[str]:
    """Return why an output's values, from `least` to `most`, are not told by double precision.

    (Higham 2002, Accuracy and stability of numerical algorithms, section 1.7 and chapter 2.)
    """
    spread, size = most - least, max(abs(least), abs(most))
    # Of what is the same in every run `stopping.no_spread` says so.
    if not SAME * size < spread:
        return []
    if spread < _SMALLEST_SPREAD:
        return [
            f"{name} varies by {spread:.1g} only, and sums cannot hold the squares of such numbers "
            "(give it in a smaller unit)"
        ]
    if ROUNDING * size > _HIDDEN * spread:
        return [
            f"{name} varies by {spread:.1g} about {size:.1g}, and of such numbers too few digits "
            "are left for it (take off what is the same in every run)"
        ]
    return []


def in_last_digits(name: str, least: float, most: float) -> list[str]:
    """Return that an output, from `least` to `most`, differs by no more than rounding, if so."""
    size = max(abs(least), abs(most))
    if not 0.0 < most - least <= SAME * size:
        return []
    return [
        f"{name} is {size:.6g} in every row but for its last digits, and indices are those of its "
        "rounding (take off what is the same in every row)"
    ]


def _short_of_one(statistics: Mapping[str, Statistic], output: int) -> float | None:
    """Return the upper end of the sum of ST if it is below 1; None if it is not, or unknown."""
    found = statistics.get("sum_total_order")
    if found is None:
        return None
    high: NDArray[np.float64] = found.estimate(_SURE_LEVEL).high
    return float(high[output]) if high[output] < 1.0 else None


def _above_one(statistics: Mapping[str, Statistic], index: str, output: int) -> float | None:
    """Return the largest lower end of an index's intervals that is clearly above 1, if any is."""
    found = statistics.get(index)
    if found is None:
        return None
    low: NDArray[np.float64] = found.estimate(_SURE_LEVEL).low[output]
    above = low[low > CLEARLY_ABOVE_ONE]
    return float(above.max()) if above.size else None
