"""What other estimators promise: their published formulas, on the pairs that are whole."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from analysis.designs import unit_row
from analysis.sensitivity.estimators import Estimate, SaltelliEstimator
from analysis.sensitivity.estimators.other_formulas import uncentred

Array = NDArray[np.float64]


def rows_of_a_linear_model(rows: int, offset: float = 0.0, sampling: str = "sobol") -> Array:
    """y = 2 a + b + offset: S = ST = 0.8, 0.2, 0."""
    points = np.stack([unit_row("saltelli", sampling, 5, row, 3) for row in range(rows)])
    values: Array = points @ [2.0, 1.0, 0.0] + offset
    return values


def martinez(rows: Array, level: float = 0.9, parts: int = 1) -> dict[str, Estimate]:
    """Return the indices of one output, or of several in a third axis, taken in in parts."""
    values = rows.reshape(*rows.shape[:2], -1)
    estimator = SaltelliEstimator(sampling="sobol", seed=5, factors=3, outputs=values.shape[2])
    for part in np.array_split(np.arange(len(rows)), parts)[::-1]:
        estimator.add_rows(part.tolist(), values[part])
    return estimator.compared(level)["martinez"]


def pearson(x: Array, y: Array, level: float = 0.9) -> tuple[float, float, float]:
    """Return the correlation of the pairs that are whole, and its interval's ends."""
    whole = ~np.isnan(x) & ~np.isnan(y)
    found = stats.pearsonr(x[whole], y[whole])
    interval = found.confidence_interval(level)
    return found.statistic, interval.low, interval.high


def test_martinez_is_correlations_with_fishers_intervals() -> None:
    rows = rows_of_a_linear_model(64)
    found = martinez(rows)
    first, total = found["first_order"], found["total_order"]
    for i in range(3):
        value, low, high = pearson(rows[:, 1], rows[:, 2 + i])
        assert first.value[0, i] == pytest.approx(value, abs=1e-12)
        assert first.low[0, i] == pytest.approx(low, abs=1e-12)
        assert first.high[0, i] == pytest.approx(high, abs=1e-12)
        if i < 2:  # A and A_B^(3) are the same numbers, of correlation 1
            value, low, high = pearson(rows[:, 0], rows[:, 2 + i])
            assert total.value[0, i] == pytest.approx(1.0 - value, abs=1e-12)
            assert total.high[0, i] == pytest.approx(1.0 - low, abs=1e-12)
    assert total.value[0, 2] == 0.0


def test_every_estimator_finds_the_closed_form_with_many_rows() -> None:
    rows = rows_of_a_linear_model(4096)
    correlated = [estimate.value[0] for estimate in martinez(rows).values()]
    for indices in (*correlated, *uncentred(rows)):
        np.testing.assert_allclose(indices, [0.8, 0.2, 0.0], atol=0.01)


def test_without_centring_an_offset_spoils_the_indices_and_correlations_do_not_mind() -> None:
    """The signature of the paper's figure 10: an idle factor gets an index below or above zero."""
    near, far = (rows_of_a_linear_model(90, offset, "latin_hypercube") for offset in (0.0, 1000.0))
    alone = martinez(near)["first_order"].value[0]
    np.testing.assert_allclose(martinez(far)["first_order"].value[0], alone, atol=1e-5)
    assert abs(uncentred(far)[0][2]) > 1.0
    assert abs(alone[2]) < 0.3


def test_failed_runs_are_left_out_pair_by_pair() -> None:
    rows = rows_of_a_linear_model(64)
    rows[3, 1] = rows[9, 2] = np.nan
    found = martinez(rows)["first_order"].value[0]
    whole = np.delete(rows, [3, 9], axis=0)
    assert found[0] == pytest.approx(stats.pearsonr(whole[:, 1], whole[:, 2]).statistic)
    whole = np.delete(rows, 3, axis=0)
    assert found[1] == pytest.approx(stats.pearsonr(whole[:, 1], whole[:, 3]).statistic)


def test_where_nothing_varies_or_nothing_came_there_is_no_index() -> None:
    for rows in (np.ones((8, 5)), np.full((8, 5), np.nan)):
        assert all(np.all(np.isnan(estimate.value)) for estimate in martinez(rows).values())
        assert all(np.all(np.isnan(indices)) for indices in uncentred(rows))


def test_sums_give_the_correlations_of_all_runs_at_once() -> None:
    """What a snapshot holds of Martinez is what the whole table says, gaps and all."""
    rows = rows_of_a_linear_model(40, offset=1e6)[:, :, None]
    rows = np.concatenate([rows, np.sin(rows)], axis=2)
    rows[3, 1], rows[7, 0], rows[11, 2:4], rows[20] = np.nan, np.nan, np.nan, np.nan
    found = martinez(rows, 0.8, parts=2)
    ends = ("value", "low", "high")
    for output in range(2):
        a, b, mixed = rows[:, 0, output], rows[:, 1, output], rows[:, 2:, output].T
        for i, one in enumerate(mixed):
            expected = pearson(b, one, 0.8)
            first = [getattr(found["first_order"], end)[output, i] for end in ends]
            np.testing.assert_allclose(first, expected, atol=1e-7)
            if i < 2:
                value, low, high = pearson(a, one, 0.8)
                total = [getattr(found["total_order"], end)[output, i] for end in ends]
                np.testing.assert_allclose(total, (1 - value, 1 - high, 1 - low), atol=1e-7)
    # Of a factor of no influence exactly, whatever the mean.
    assert found["total_order"].value[0, 2] == 0.0
