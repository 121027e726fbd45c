"""What bounds under the worst case promise: they hold the index, whatever the failed runs hide."""

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.designs import row_width, unit_row
from analysis.sensitivity.estimators import Estimate, Estimator, estimator_class
from analysis.sensitivity.judgement.worst_case import worst_case
from tests.testbed.functions.scalar import KNOWN

ROWS, FACTORS = 256, 6
Array = NDArray[np.float64]


def estimated(method: str, values: Array) -> Estimator:
    estimator = estimator_class(method)(sampling="owen_blocks", seed=3, factors=FACTORS, outputs=1)
    estimator.add_rows(range(ROWS), values[..., None])
    return estimator


def bounds(method: str, values: Array) -> dict[str, Estimate]:
    estimator = estimated(method, values)
    return worst_case(estimator, estimator.statistics(), 0.9)


def ishigami(method: str) -> Array:
    points = np.stack([unit_row(method, "owen_blocks", 3, row, FACTORS) for row in range(ROWS)])
    return KNOWN["ishigami"].function(points)


@pytest.mark.parametrize("method", ["morris", "saltelli"])
def test_without_failures_they_are_the_intervals(method: str) -> None:
    values = ishigami(method)
    indices = estimated(method, values).indices(0.9)
    for name, found in bounds(method, values).items():
        np.testing.assert_allclose(found.low, indices[name].low, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.high, indices[name].high, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", ["morris", "saltelli"])
@pytest.mark.parametrize("hidden", ["least", "most", "either", "as it was"])
def test_they_hold_the_index_of_whatever_the_failed_runs_would_have_been(
    method: str, hidden: str
) -> None:
    """Of runs that fail where the output is high, filled in with the worst that was seen."""
    whole = ishigami(method)
    rng = np.random.default_rng(4)
    failed = (whole > np.quantile(whole, 0.9)) & (rng.random(whole.shape) < 0.2)
    seen = np.where(failed, np.nan, whole)
    least, most = float(np.nanmin(seen)), float(np.nanmax(seen))
    filling = {
        "least": least,
        "most": most,
        "either": np.where(rng.random(whole.shape) < 0.5, least, most),
        "as it was": np.minimum(whole, most),
    }[hidden]
    index = estimated(method, np.where(failed, filling, whole)).indices(0.9)
    for name, found in bounds(method, seen).items():
        # An estimate of a share may leave 0 to 1, a share may not.
        value = np.clip(index[name].value, 0.0, 1.0) if method == "saltelli" else index[name].value
        assert np.all(found.low <= value + 1e-12)
        assert np.all(value - 1e-12 <= found.high)


def test_few_failures_leave_bounds_that_say_something() -> None:
    values = ishigami("saltelli")
    values[3, 2] = values[90, 0] = np.nan
    total = bounds("saltelli", values)["total_order"]
    assert total.low[0, 0] > 0.3 and total.high[0, 4] < 0.11
    assert row_width("saltelli", FACTORS) == values.shape[1]
