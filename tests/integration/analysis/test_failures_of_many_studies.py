"""How often failures that go with an output are noticed, over hundreds of studies."""

from functools import cache

import numpy as np
import pytest

from analysis.sensitivity.estimators import SaltelliEstimator
from analysis.sensitivity.judgement.failures import WRONGLY


@cache
def rows_that_fail(tie: float, studies: int = 300, rows: int = 512) -> SaltelliEstimator:
    """Return studies as outputs, of which 10 % of the runs fail, more so in rows of high values."""
    rng = np.random.default_rng(5)
    high = rng.normal(size=(rows, 1, studies))
    values = high + 0.5 * rng.normal(size=(rows, 4, studies))
    values[rng.random(values.shape) < 0.1 * (1.0 + tie * high)] = np.nan
    estimator = SaltelliEstimator(
        sampling="owen_blocks", seed=1, factors=2, outputs=studies, indicators=0
    )
    estimator.add_rows(range(rows), values)
    return estimator


def noticed(estimator: SaltelliEstimator) -> float:
    found = estimator.failing_with()
    return float(np.mean(np.abs(found.correlation) * np.sqrt(found.rows - 1.0) > 2.576))


def test_failures_at_random_seem_to_go_with_an_output_as_rarely_as_is_said() -> None:
    assert noticed(rows_that_fail(0.0)) == pytest.approx(WRONGLY, abs=0.015)


def test_what_nine_studies_of_ten_would_notice_is_noticed_by_as_many() -> None:
    found = rows_that_fail(0.0).failing_with()
    detectable = float(np.median((2.576 + 1.282) / np.sqrt(found.rows - 1.0) * found.off))
    # A row's mean of three has the standard deviation sqrt(1 + 0.25 / 3) and slope 1 on `high`.
    tie = detectable * np.sqrt(1.0 + 0.25 / 3.0)
    assert noticed(rows_that_fail(tie)) == pytest.approx(0.9, abs=0.06)
