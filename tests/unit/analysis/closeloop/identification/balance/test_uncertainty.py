"""An interval is made of the fits with a part left out."""

import numpy as np
import pytest
from scipy import stats

from analysis.closeloop.identification.balance.uncertainty import (
    Fits,
    _sure,
    half_width,
    variance,
)


def means(sample: np.ndarray) -> Fits:
    """Return the fits of a sample's mean, (trials, k): to all of it, and without each trial."""
    without = (sample.sum(axis=0) - sample) / (len(sample) - 1)
    return Fits(
        coefficients=np.vstack([sample.mean(axis=0), without]),
        thetas={},
        steps=np.empty(0),
        sizes=(len(sample),),
        white=(),
    )


def test_the_interval_of_a_mean_is_students() -> None:
    sample = np.random.default_rng(3).normal(2.0, 0.5, 7)
    left_out = np.array([np.delete(sample, i).mean() for i in range(7)])
    _, high = stats.t.interval(0.9, 6, sample.mean(), stats.sem(sample))
    half = half_width(variance(float(sample.mean()), left_out), 6.0)
    assert half == pytest.approx(high - sample.mean())


def test_places_count_only_beyond_what_noise_makes_of_them() -> None:
    alone = half_width(4.0, 7.0)
    assert alone == pytest.approx(2.0 * stats.t.ppf(0.95, 7))
    assert half_width(4.0, 7.0, [(-1.0, 15.0), (-0.1, 4.0)]) == alone
    freedom = 13.0**2 / (4.0**2 / 7 + 9.0**2 / 4)
    wide = half_width(4.0, 7.0, [(2.0, 15.0), (9.0, 4.0)])
    assert wide == pytest.approx(np.sqrt(13.0) * stats.t.ppf(0.95, freedom))


def test_an_interval_holds_the_whole_fit_and_ends_at_a_physical_bound() -> None:
    one = np.eye(1)
    fits = Fits(
        coefficients=np.empty((0, 1)), thetas={}, steps=np.ones(1), sizes=(3,), white=(one,)
    )
    low, high = fits.interval(np.array([0.3, 0.3, 0.2, 0.4, 0.3]), 0.05, lowest=0.0)
    assert low == 0.0
    assert high >= 0.3


@pytest.mark.parametrize("size", [1, 2, 3])
def test_what_is_nothing_is_sure_in_a_tenth_of_all_cases(size: int) -> None:
    rng = np.random.default_rng(7)
    mixed = rng.standard_normal((size, size))
    seen = [means(rng.standard_normal((6, size)) @ mixed) for _ in range(2000)]
    sure = [_sure(fits, fits.coefficients[0], fits.coefficients) > 1.0 for fits in seen]
    assert np.mean(sure) == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / 2000))


def test_two_coefficients_may_be_sure_together_where_neither_is_alone() -> None:
    """A drift's rate and beginning, as trials see them: their sum is known, not their parts."""
    rng = np.random.default_rng(1)
    share = rng.normal(0.0, 5.0, 6)
    fits = means(np.column_stack([1.0 + share, 1.0 - share + rng.normal(0.0, 0.1, 6)]))
    for one in (0, 1):
        assert _sure(fits, fits.coefficients[0, [one]], fits.coefficients[:, [one]]) < 1.0
    assert _sure(fits, fits.coefficients[0], fits.coefficients) > 5.0
    few = means(np.ones((2, 2)))
    assert _sure(few, few.coefficients[0], few.coefficients) == 0.0
