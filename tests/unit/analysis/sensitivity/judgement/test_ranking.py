"""What a ranking promises: the sample's order, and how many replicates share it."""

import numpy as np
import pytest

from analysis.sensitivity.judgement.ranking import rank
from analysis.sensitivity.service import analyse
from tests.testbed.studies import results_of, study_plan


def test_the_share_of_replicates_with_the_same_order_is_counted() -> None:
    weighted = np.array([[3.0, 1.0, 2.0], [3.0, 1.0, 2.0], [3.0, 2.0, 1.0], [1.0, 0.0, 2.0]])
    ranking = rank(weighted, ("x", "y", "z"))
    assert ranking is not None
    assert ranking.order == ("x", "z", "y")
    assert ranking.same_order == pytest.approx(1 / 3)
    assert ranking.same_first == pytest.approx(2 / 3)


def test_the_order_is_the_sample_s_though_most_replicates_have_another() -> None:
    weighted = np.array([[3.0, 1.0, 2.0], [1.0, 0.0, 2.0], [1.0, 0.0, 2.0], [3.0, 1.0, 2.0]])
    ranking = rank(weighted, ("x", "y", "z"))
    assert ranking is not None
    assert ranking.order == ("x", "z", "y")
    assert (ranking.same_order, ranking.same_first) == pytest.approx((1 / 3, 1 / 3))


def test_factors_of_equal_influence_stay_in_their_order() -> None:
    names = tuple(f"x{i}" for i in range(40))
    ranking = rank(np.tile(np.arange(40) % 2 == 0, (3, 1)).astype(float), names)
    assert ranking is not None
    assert ranking.order == (*names[::2], *names[1::2])


def test_replicates_without_an_index_are_left_out_unless_they_are_most() -> None:
    weighted = np.array([[2.0, 1.0], [2.0, 1.0], [np.nan, 1.0]])
    ranking = rank(weighted, ("x", "y"))
    assert ranking is not None and ranking.same_order == 1.0
    assert rank(np.array([[2.0, 1.0], [np.nan, 1.0], [np.nan, 1.0]]), ("x", "y")) is None
    assert rank(np.array([[np.nan, 1.0], [2.0, 1.0]]), ("x", "y")) is None


def test_a_clear_ranking_is_stable_and_a_tie_is_not() -> None:
    plan = study_plan("saltelli", rows=256)
    clear = analyse(plan, results_of(plan))["outputs"]["y"]["ranking"]
    assert (clear["by"], clear["order"]) == ("total_order", ["a", "c", "b"])
    assert clear["same_first"] == 1.0
    tie = analyse(plan, results_of(plan, lambda x: {"y": x["a"] + x["b"], "z": 0.0}))
    assert 0.2 < tie["outputs"]["y"]["ranking"]["same_order"] < 0.9
    assert tie["outputs"]["z"]["ranking"]["order"] is None
