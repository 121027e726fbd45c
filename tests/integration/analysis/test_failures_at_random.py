"""Failures that strike at random are told from those that factors cause, in many studies."""

import numpy as np
import pytest

from analysis.designs import METHODS, SINGLE_POINTS
from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan


def failing(plan: StudyPlan, share: float, seed: int) -> list[tuple[int, int]]:
    """Return places that fail whatever the factors."""
    rng = np.random.default_rng(seed)
    width = len(FACTORS) + (1 if plan.method == "morris" else 2)
    return [tuple(place) for place in np.argwhere(rng.random((plan.rows, width)) < share).tolist()]


@pytest.mark.parametrize("method", [method for method in METHODS if method not in SINGLE_POINTS])
def test_failures_at_random_rarely_raise_the_alarm(method: str) -> None:
    alarms = 0
    for seed in range(25):
        plan = study_plan(method, rows=192, seed=seed)
        results = results_of(plan, failed=failing(plan, 0.05, seed))
        failure = analyse(plan, results)["failure"]
        assert failure["depends_on_factors"] is not None
        alarms += failure["depends_on_factors"]
        assert bool(failure["caused_by"]) <= failure["depends_on_factors"]
    assert alarms <= 3
