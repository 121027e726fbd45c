"""What other estimators promise: their published formulas, on the pairs that are whole."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from analysis.designs import unit_row
from analysis.sensitivity.comparison import compare
from analysis.sensitivity.estimators import SaltelliEstimator


def rows_of_a_linear_model(
    rows: int, offset: float = 0.0, sampling: str = "sobol"
) -> NDArray[np.float64]:
    """y = 2 a + b + offset: S = ST = 0.8, 0.2, 0."""
    points = np.stack([unit_row("saltelli", sampling, 5, row, 3) for row in range(rows)])
    values: NDArray[np.float64] = points @ [2.0, 1.0, 0.0] + offset
    return values


def test_martinez_is_correlations_with_fishers_intervals() -> None:
    rows = rows_of_a_linear_model(64)
    found = compare(rows, level=0.9)["martinez"]
    for i in range(3):
        first = stats.pearsonr(rows[:, 1], rows[:, 2 + i])
        interval = first.confidence_interval(0.9)
        assert found.first.value[i] == pytest.approx(first.statistic, abs=1e-12)
        assert found.first.low[i] == pytest.approx(interval.low, abs=1e-12)
        assert found.first.high[i] == pytest.approx(interval.high, abs=1e-12)
        if i < 2:  # A and A_B^(3) are the same numbers, of correlation 1
            total = stats.pearsonr(rows[:, 0], rows[:, 2 + i])
            assert found.total.value[i] == pytest.approx(1.0 - total.statistic, abs=1e-12)
            assert found.total.high[i] == pytest.approx(
                1.0 - total.confidence_interval(0.9).low, abs=1e-12
            )
    np.testing.assert_allclose(found.total.value[2], 0.0, atol=1e-12)


def test_every_estimator_finds_the_closed_form_with_many_rows() -> None:
    for compared in compare(rows_of_a_linear_model(4096)).values():
        np.testing.assert_allclose(compared.first.value, [0.8, 0.2, 0.0], atol=0.01)
        np.testing.assert_allclose(compared.total.value, [0.8, 0.2, 0.0], atol=0.01)


def test_without_centring_an_offset_spoils_the_indices_and_correlations_do_not_mind() -> None:
    """The signature of the paper's figure 10: an idle factor gets an index below or above zero."""
    near, far = (
        compare(rows_of_a_linear_model(90, offset, "latin_hypercube")) for offset in (0.0, 1000.0)
    )
    np.testing.assert_allclose(far["martinez"].first.value, near["martinez"].first.value, atol=1e-5)
    assert abs(far["uncentred"].first.value[2]) > 1.0
    assert abs(near["martinez"].first.value[2]) < 0.3
    assert np.all(np.isnan(far["uncentred"].first.low))


def test_failed_runs_are_left_out_pair_by_pair() -> None:
    rows = rows_of_a_linear_model(64)
    rows[3, 1] = rows[9, 2] = np.nan
    found = compare(rows)["martinez"].first
    whole = np.delete(rows, [3, 9], axis=0)
    assert found.value[0] == pytest.approx(stats.pearsonr(whole[:, 1], whole[:, 2]).statistic)
    whole = np.delete(rows, 3, axis=0)
    assert found.value[1] == pytest.approx(stats.pearsonr(whole[:, 1], whole[:, 3]).statistic)


def test_where_nothing_varies_or_nothing_came_there_is_no_index() -> None:
    for rows in (np.ones((8, 5)), np.full((8, 5), np.nan)):
        for compared in compare(rows).values():
            assert np.all(np.isnan(compared.first.value))
            assert np.all(np.isnan(compared.total.value))


def test_sums_give_the_correlations_of_all_runs_at_once() -> None:
    """What a snapshot holds of Martinez is what a report computes from the table, gaps and all."""
    rows = rows_of_a_linear_model(40, offset=1e6)[:, :, None]
    rows = np.concatenate([rows, np.sin(rows)], axis=2)
    rows[3, 1], rows[7, 0], rows[11, 2:4], rows[20] = np.nan, np.nan, np.nan, np.nan
    estimator = SaltelliEstimator(sampling="sobol", seed=5, factors=3, outputs=2)
    for part in (slice(25, 40), slice(0, 25)):
        estimator.add_rows(range(40)[part], rows[part])
    found = estimator.compared(0.8)["martinez"]
    for output in range(2):
        expected = compare(rows[..., output], level=0.8)["martinez"]
        for index, oracle in (("first_order", expected.first), ("total_order", expected.total)):
            for end in ("value", "low", "high"):
                np.testing.assert_allclose(
                    getattr(found[index], end)[output], getattr(oracle, end), atol=1e-7
                )
    # Of a factor of no influence exactly, whatever the mean.
    assert found["total_order"].value[0, 2] == 0.0
