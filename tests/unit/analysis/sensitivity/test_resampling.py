"""Replicates and intervals of indices, against the slow way to them."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.designs import BLOCKS, blocks_of
from analysis.sensitivity.estimators import (
    Estimator,
    MorrisEstimator,
    SaltelliEstimator,
    SecondOrderEstimator,
    ShapleyEstimator,
)
from analysis.sensitivity.estimators.bootstrap import replicate_weights
from analysis.sensitivity.estimators.intervals import (
    fieller,
    jackknife_error,
    satterthwaite,
    student,
    without_bias,
)
from analysis.sensitivity.estimators.shares import (
    allowing_for_tails,
    kept_apart,
    lacking_a_tail,
    longer,
    share_of_squares,
)
from analysis.sensitivity.estimators.tails import tail
from tests.testbed.estimators import (
    FACTORS,
    OUTPUTS,
    SEED,
    empty,
    fed,
    values_of,
)

EVERY_INDEX = [
    (MorrisEstimator, "mu", None),
    (MorrisEstimator, "mu_star", 1),
    (MorrisEstimator, "sigma", 2),
    (SaltelliEstimator, "first_order", None),
    (SaltelliEstimator, "total_order", 1),
    (SaltelliEstimator, "sum_first_order", None),
    (SaltelliEstimator, "sum_total_order", 1),
    (SaltelliEstimator, "dummy_first_order", None),
    (SecondOrderEstimator, "first_order", None),
    (SecondOrderEstimator, "second_order", None),
]


def fed_alone(cls: type[Estimator], rows: NDArray[np.int_], values: NDArray[np.float64]) -> Any:
    """Return the indices of an estimator that sees these rows only."""
    estimator = empty(cls)
    estimator.add_rows(rows.tolist(), values[rows])
    return estimator.indices()


@cache
def resampled(cls: type[Estimator]) -> list[Any]:
    """Return the indices of 15 rows, and of the first 40 samples of them with repetition."""
    once = np.ones((1, 15), dtype=int)
    weights = replicate_weights(SEED, range(15))[:40].astype(int)
    return [
        fed_alone(cls, np.repeat(np.arange(15), weighting), values_of(cls, 15))
        for weighting in np.concatenate([once, weights])
    ]


@pytest.mark.parametrize(
    ("cls", "name", "power"), [*EVERY_INDEX, (ShapleyEstimator, "shapley", None)]
)
def test_a_replicate_is_the_index_of_rows_repeated_as_its_weights_say(
    cls: type[Estimator], name: str, power: int | None
) -> None:
    """Replicates the slow way: an estimator fed a resampled set of rows."""
    slow = [indices[name].value for indices in resampled(cls)]
    # The variance of n rows drawn from n rows is too small by (n - 1) / n in the mean.
    slow[1:] = np.array(slow[1:]) * (np.sqrt(15 / 14) if name == "sigma" else 1.0)
    found = fed(cls, values_of(cls, 15)).statistics()[name]
    np.testing.assert_allclose(found.weighted[:41], slow, rtol=1e-12, atol=1e-12)
    assert found.power == power


def stretch_of(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `Tail.stretch` from the runs, shape (outputs, factors)."""
    size = np.abs(np.moveaxis(values[:, 2 : 2 + FACTORS], 1, 2) - values[:, 0, :, None])
    half, first, second, fourth = (np.nanmean(size**p, axis=0) for p in (0.5, 1.0, 2.0, 4.0))
    n = np.sum(~np.isnan(size), axis=0)
    return tail(half=half, first=first, second=second, fourth=fourth, n=n).stretch


def sides_of(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `longer` of the outputs' kurtosis from the runs, shape (outputs, 1)."""
    between = values[:, 0] - values[:, 1]
    second, fourth = (np.nanmean(between**p, axis=0) for p in (2, 4))
    return longer(2.0 * fourth / second**2 - 3.0)[:, None]


@cache
def without_each_block(cls: type[Estimator]) -> list[tuple[NDArray[np.float64], Any]]:
    """Return of 24 rows, each block left out in turn, the outputs' variance and the indices."""
    values = with_a_failure(cls)
    blocks = blocks_of("sobol", SEED, range(24))
    found = []
    for block in range(BLOCKS):
        others = np.flatnonzero(blocks != block)
        variance = np.nanvar(values[others, :2], axis=(0, 1))
        found.append((variance, fed_alone(cls, others, values)))
    return found


def with_a_failure(cls: type[Estimator]) -> NDArray[np.float64]:
    values = values_of(cls, 24)
    values[5, 1] = np.nan
    return values


@pytest.mark.parametrize(("cls", "name", "power"), EVERY_INDEX)
def test_an_interval_is_made_of_what_the_index_is_without_each_block(
    cls: type[Estimator], name: str, power: int | None
) -> None:
    """The slow way: an estimator for each block that never sees its rows."""
    values = with_a_failure(cls)
    estimator = fed(cls, values)
    found = estimator.indices(level=0.8)[name]
    slow = [indices[name].value for _, indices in without_each_block(cls)]
    wholes = [np.nanvar(values[:, :2], axis=(0, 1))]
    wholes += [variance for variance, _ in without_each_block(cls)]
    present = np.ones((BLOCKS, *found.value.shape), dtype=np.bool_)
    statistic = estimator.statistics()[name]
    if name == "total_order":
        expected = share_of_squares(
            found.value,
            np.stack(slow),
            present,
            0.8,
            whole=np.stack(wholes)[..., None],
            stretch=stretch_of(values),
            times=sides_of(values),
        )
    elif power is not None:
        stretch = None if statistic.tail is None else statistic.tail.stretch
        expected = satterthwaite(found.value, np.stack(slow), present, 0.8, power, stretch)
        if statistic.longer is not None and statistic.whole is None:
            expected = lacking_a_tail(
                *(expected, np.stack(slow), present, 0.8), power=power, times=statistic.longer
            )
        if name == "sigma":
            # Sums of squares about 0, less the mean's square without its own error's.
            mean = estimator.statistics()["mu"]
            error = jackknife_error(mean.without, mean.present)
            squares = (1.0 - 1.0 / mean.n) * found.value**2 + error**2
            moves = found.value > 0.0
            scale = np.sqrt(squares) / np.where(moves, found.value, 1.0)
            expected = without_bias(expected, np.where(moves, scale, 1.0))
    elif name == "mu":
        expected = student(found.value, np.stack(slow), present, 0.8)
    else:
        whole = np.stack(wholes).reshape(-1, OUTPUTS, *[1] * (found.value.ndim - 1))
        expected = fieller(found.value, np.stack(slow), present, 0.8, whole)
        if name == "first_order":
            sides = sides_of(values)
            expected = allowing_for_tails(
                *(expected, np.stack(slow), present, 0.8), whole=whole, times=sides
            )
    if statistic.apart is not None:
        expected = kept_apart(expected, statistic.weighted, statistic.apart, 0.8)
    if power is not None:
        expected = replace(expected, low=np.maximum(expected.low, 0.0))
    np.testing.assert_allclose(found.low, expected.low, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.high, expected.high, rtol=1e-9, atol=1e-12)
