"""Which factors make runs fail: sensitivity of the indicator that is 1 for a failed run.

Indices of the outputs say nothing about the runs that failed. If failures fall on some values of
the factors more than on others, the outputs' indices describe a population that the study did not
mean, and the reader must know. Failures that strike at random leave marks of their own: mu and the
first-order indices of the indicator are 0, and mu* and the total-order index are the same for each
factor, those of a dummy. What departs from these marks is due to the factors. (Sheikholeslami,
Razavi and Haghnegahdar 2019, What should we do when a model crashes?, fill in the missing outputs;
here they stay missing, and the crash is an output.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from analysis.designs import SINGLE_POINTS, family
from analysis.designs.radial import MEAN_INVERSE_STEP
from analysis.designs.trajectories import STEP, TRAJECTORIES
from analysis.sensitivity.estimators import Estimator, Statistic
from analysis.sensitivity.estimators.bootstrap import percentiles

#: Bootstrap standard errors that a mark must be off by. Where 5 % of the runs fail at random, 1 to
#: 7 studies in 100 raise the alarm; failures that a factor causes are off by far more.
ERRORS = 3.5

#: Of the intervals of two factors that must not overlap for one to stand out.
LEVEL = 0.99

#: Share of the studies in which failures at random may seem to go with an output.
WRONGLY = 0.01

#: With fewer failed runs a standard error means nothing.
FEWEST = 20

#: By method: the index that is 0 and the one that is a dummy's, if failures strike at random.
_MARKS = {
    "morris": ("mu", "mu_star"),
    "saltelli": ("first_order", "total_order"),
    "shapley": ("full_first_order", "independent_total_order"),
}


@dataclass(frozen=True, kw_only=True)
class FailureDependence:
    """What is known of a study's failures."""

    #: Whether failures depend on the factors; None while there are too few to tell.
    depends_on_factors: bool | None
    #: The factors that stand out, the most influential first; may be empty all the same.
    caused_by: tuple[str, ...]
    #: The outputs that are higher or lower where runs fail.
    goes_with: tuple[str, ...] = ()
    #: By how many standard deviations the rows of failed runs must be off in an output for nine
    #: studies of ten to notice; None if that is unknown.
    detectable: float | None = None
    #: For the reader; empty if no run failed.
    sentence: str


def judge(
    estimator: Estimator,
    statistics: Mapping[str, Statistic],
    column: int,
    names: Sequence[str],
    outputs: Sequence[str] = (),
    *,
    failed: int,
    runs: int,
) -> FailureDependence:
    """Say whether failures depend on the factors, and on which.

    Their indicator as an output is ours; what is usual is to fill in (Sheikholeslami et al. 2019).

    Args:
        estimator: of the study; the output `column` is 1 where a run failed and 0 elsewhere.
        statistics: of the estimator.
        names: of the factors.
        outputs: names of the outputs before `column`.
        failed, runs: how many runs failed, of how many.
    """
    if failed == 0:
        return FailureDependence(depends_on_factors=None, caused_by=(), sentence="")
    start = f"{failed} of {runs} runs failed ({failed / runs:.1%})"
    if failed < FEWEST:
        return FailureDependence(
            depends_on_factors=None,
            caused_by=(),
            sentence=f"{start}: too few to tell whether failures depend on the factors.",
        )
    if estimator.method in SINGLE_POINTS:
        return FailureDependence(
            depends_on_factors=None,
            caused_by=(),
            sentence=f"{start}: single points do not tell whether failures depend on the factors.",
        )
    zero, floor = _MARKS[family(estimator.method)]
    alone = _errors_off(statistics[zero].weighted[:, column])
    with_others = statistics[floor].weighted[:, column]
    contrast = _errors_off(with_others - _dummy(estimator, column)[:, None])
    spread = percentiles(with_others, statistics[floor].n[column], LEVEL)
    # A share cannot be negative, a mean effect can.
    stands_out = (np.abs(alone) if zero == "mu" else alone) > ERRORS
    order = np.argsort(-np.nan_to_num(spread.value), kind="stable")
    caused = stands_out | (spread.low > spread.high[int(order[-1])])
    factors = tuple(names[f] for f in order if caused[f])
    with_output, detectable = _with_outputs(estimator, outputs)
    depends = bool(factors) or bool(with_output) or bool(np.any(contrast < -ERRORS))
    if not depends:
        sentence = f"{start}; nothing shows that failures depend on the factors."
        if detectable is not None:
            sentence += (
                f" Had the rows of failed runs been {detectable:.2g} standard deviations off in an "
                "output, nine of ten such studies would show it."
            )
    else:
        which = f": {', '.join(factors)}" if factors else ""
        also = " and ".join(f"{kind} {output}" for output, kind in with_output.items())
        sentence = (
            f"{start}, and failures depend on the factors{which}."
            f"{f' They go with {also}.' if also else ''} The indices of the outputs "
            "describe the runs that succeeded, not the ranges as asked."
        )
    return FailureDependence(
        depends_on_factors=depends,
        caused_by=factors,
        goes_with=tuple(with_output),
        detectable=detectable,
        sentence=sentence,
    )


def _with_outputs(
    estimator: Estimator, outputs: Sequence[str]
) -> tuple[dict[str, str], float | None]:
    """Return outputs that are "high" or "low" where runs fail, and what would have been noticed.

    By the correlation of Pitman 1937; wrongly so in `WRONGLY` of the studies, all outputs together.
    """
    if not outputs:
        return {}, None
    found = estimator.failing_with()
    errors = np.sqrt(np.maximum(found.rows - 1.0, 1.0))
    least = -ndtri(WRONGLY / (2.0 * len(outputs)))
    tied = {
        name: "high" if found.correlation[o] > 0.0 else "low"
        for o, name in enumerate(outputs)
        if abs(found.correlation[o]) * errors[o] > least
    }
    noticed = ((least + ndtri(0.9)) / errors * found.off)[: len(outputs)]
    known = noticed[np.isfinite(noticed)]
    return tied, float(known.max()) if known.size else None


def _errors_off(weighted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a statistic in units of its bootstrap standard error, shape (factors,).

    0 where the replicates do not vary or most are undefined.
    """
    known = ~np.isnan(weighted[1:])
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, weighted[1:], 0.0).sum(axis=0) / count
    error = np.sqrt(np.where(known, (weighted[1:] - mean) ** 2, 0.0).sum(axis=0) / count)
    usable = (known.mean(axis=0) >= 0.5) & (error > 0.0) & ~np.isnan(weighted[0])
    off: NDArray[np.float64] = np.divide(weighted[0], error, out=np.zeros_like(error), where=usable)
    return off


def _dummy(estimator: Estimator, column: int) -> NDArray[np.float64]:
    """Return what a dummy factor has of the second mark in every weighting, shape (weightings,).

    Two runs that fail independently with probability p differ with probability 2 p (1 - p), which
    is twice the indicator's variance.
    """
    p = estimator.weighted_mean(column)
    if family(estimator.method) != "morris":
        return np.ones_like(p)
    inverse_step = 1.0 / STEP if estimator.sampling in TRAJECTORIES else MEAN_INVERSE_STEP
    dummy: NDArray[np.float64] = 2.0 * p * (1.0 - p) * inverse_step
    return dummy
