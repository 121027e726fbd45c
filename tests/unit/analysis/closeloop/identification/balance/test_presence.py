"""What may be nothing is called so, and what is sure together is there."""

import numpy as np
import pytest

from analysis.closeloop.identification.balance.presence import _sure
from analysis.closeloop.identification.balance.uncertainty import Fits


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
