"""What the bootstrap promises: Poisson weights by a pure function, and percentile intervals."""

import numpy as np
import pytest
from scipy import stats

from analysis.sensitivity.estimators.bootstrap import REPLICATES, percentiles, replicate_weights


def test_weights_are_a_pure_function_of_seed_and_row() -> None:
    together = replicate_weights(3, [5, 900, 2**40])
    for place, row in enumerate([5, 900, 2**40]):
        assert np.array_equal(replicate_weights(3, [row])[:, 0], together[:, place])
    assert not np.array_equal(replicate_weights(4, [5]), replicate_weights(3, [5]))
    assert replicate_weights(1, [60])[:15, 0].tolist() == [
        3,
        1,
        0,
        1,
        0,
        0,
        1,
        0,
        2,
        0,
        1,
        1,
        2,
        1,
        2,
    ]


def test_weights_follow_poissons_law() -> None:
    counts = replicate_weights(8, range(500)).ravel().astype(int)
    observed = np.bincount(np.minimum(counts, 5), minlength=6)
    law = stats.poisson(1.0)
    expected = counts.size * np.array([*law.pmf(range(5)), law.sf(4)])
    assert stats.chisquare(observed, expected).pvalue > 1e-3


def test_weights_of_neighbouring_rows_and_replicates_are_unrelated() -> None:
    counts = replicate_weights(8, range(500))
    correlation = np.corrcoef(counts)
    np.fill_diagonal(correlation, 0.0)
    assert np.max(np.abs(correlation)) < 5.5 / np.sqrt(500)
    assert abs(np.corrcoef(counts[:, :-1].ravel(), counts[:, 1:].ravel())[0, 1]) < 0.02


def test_an_interval_of_many_rows_is_numpys_percentiles_of_the_replicates() -> None:
    replicates = np.random.default_rng(2).normal(size=(1 + REPLICATES, 3, 4))
    found = percentiles(replicates, np.full((3, 4), 10**9), 0.8)
    assert np.array_equal(found.value, replicates[0])
    np.testing.assert_allclose(found.low, np.quantile(replicates[1:], 0.1, axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.high, np.quantile(replicates[1:], 0.9, axis=0), rtol=1e-6)


def test_few_rows_widen_an_interval_as_students_t_does() -> None:
    """Hesterberg 2015: as wide as a t interval, if the replicates are those of a normal mean."""
    n, s = 10, 3.0
    normal = stats.norm.ppf((np.arange(REPLICATES) + 0.5) / REPLICATES)
    # The spread that resampling ten rows with sample deviation s gives their mean.
    replicates = np.append(0.0, normal * s * np.sqrt((n - 1) / n) / np.sqrt(n))[:, None]
    found = percentiles(replicates, np.array([n]), 0.9)
    half = stats.t.ppf(0.95, n - 1) * s / np.sqrt(n)
    assert found.high[0] == pytest.approx(half, rel=0.02)
    assert found.low[0] == pytest.approx(-half, rel=0.02)


def test_undefined_replicates_are_left_out_unless_they_are_most() -> None:
    replicates = np.random.default_rng(2).normal(size=(1 + REPLICATES, 4))
    replicates[1:50, 0] = np.nan
    replicates[1:150, 1] = np.nan
    replicates[0, 2] = np.nan
    found = percentiles(replicates, np.array([10**9, 10**9, 10**9, 1]), 0.9)
    assert found.low[0] == pytest.approx(np.quantile(replicates[50:, 0], 0.05), rel=1e-6)
    assert np.array_equal(np.isnan(found.low), [False, True, True, True])
    assert np.array_equal(np.isnan(found.high), [False, True, True, True])
    assert np.array_equal(np.isnan(found.value), [False, False, True, False])


@pytest.mark.parametrize("level", [0.0, 1.0, 90.0])
def test_a_level_is_a_probability(level: float) -> None:
    with pytest.raises(ValueError, match="level of an interval must be between 0 and 1"):
        percentiles(np.zeros((1 + REPLICATES, 1)), np.array([5]), level)
