"""What Morris's trajectories promise: his design on a grid, spread wide, and SALib's effects."""

import numpy as np
import pytest
from SALib.analyze import morris as salib_morris

from analysis.designs import samplings, unit_row
from analysis.designs.radial import legs
from analysis.designs.trajectories import CHOSEN, LEVELS, STEP, distances, far_apart
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan

SEED, K = 4, 5


def trajectories(
    rows: int, seed: int = SEED
) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    return np.stack([unit_row("morris", "trajectories", seed, row, K) for row in range(rows)])


def test_each_step_moves_one_factor_by_half_its_levels_and_each_factor_once() -> None:
    points = trajectories(30)
    assert set(np.unique(points)) == {0.125, 0.375, 0.625, 0.875}
    assert len(np.unique(points)) == LEVELS
    steps = np.diff(points, axis=1)
    assert set(np.unique(np.abs(steps))) == {0.0, STEP}
    moves = steps != 0.0
    assert np.all(moves.sum(axis=1) == 1) and np.all(moves.sum(axis=2) == 1)


def test_a_trajectory_depends_on_seed_and_number_alone() -> None:
    """Nothing of a running study may move under a new version of this code or NumPy."""
    expected = [
        [0.875, 0.125, 0.375],
        [0.875, 0.125, 0.875],
        [0.875, 0.625, 0.875],
        [0.375, 0.625, 0.875],
    ]
    assert unit_row("morris", "trajectories", 1, 13, 3).tolist() == expected


def test_legs_are_the_moves_of_the_row() -> None:
    for points in trajectories(10):
        (before, after), steps = legs(points)
        assert np.array_equal(after, before + 1)
        for factor in range(K):
            move = points[after[factor]] - points[before[factor]]
            assert np.flatnonzero(move).tolist() == [factor]
            assert move[factor] == steps[factor]


def test_levels_and_orders_are_drawn_evenly() -> None:
    points = trajectories(1000)
    share = np.mean(points[:, 0] == 0.125, axis=0)
    np.testing.assert_allclose(share, 1.0 / LEVELS, atol=0.05)
    first_to_move = np.argmax(points[:, 1] != points[:, 0], axis=1)
    np.testing.assert_allclose(np.bincount(first_to_move) / 1000, 1.0 / K, atol=0.05)


def test_chosen_trajectories_lie_further_apart_than_random_ones() -> None:
    """Ten of a batch against ten walks that nobody chose."""
    rng = np.random.default_rng(1)

    def walk() -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
        start = rng.choice([0.125, 0.375, 0.625, 0.875], size=K)
        end = np.where(start < 0.5, start + STEP, start - STEP)
        return np.where(rng.permutation(K) < np.arange(K + 1)[:, None], end, start)

    chosen = np.mean([distances(trajectories(CHOSEN, seed)).mean() for seed in range(30)])
    random = np.mean(
        [distances(np.stack([walk() for _ in range(CHOSEN)])).mean() for _ in range(30)]
    )
    assert chosen > 1.02 * random


def test_the_choice_takes_the_furthest_pair_then_what_is_far_from_it() -> None:
    place = np.array([0.0, 1.0, 5.0, 9.0, 10.0])
    assert far_apart(np.abs(place[:, None] - place), 3) == [0, 4, 1]


def test_effects_are_salibs() -> None:
    """SALib divides by 2/3, the step of levels that are ends; here levels are middles."""
    points = trajectories(20)
    values = points[..., 0] + 3.0 * points[..., 1] * points[..., 2] + np.sin(4.0 * points[..., 3])
    problem = {"num_vars": K, "names": list("abcde"), "bounds": [[0.0, 1.0]] * K}
    oracle = salib_morris.analyze(
        problem, points.reshape(-1, K), values.ravel(), num_levels=LEVELS, num_resamples=2
    )
    estimator = MorrisEstimator(sampling="trajectories", seed=SEED, factors=K, outputs=1)
    estimator.add_rows(range(20), values[..., None])
    found = estimator.indices()
    scale = (2.0 / 3.0) / STEP
    for ours, theirs in (("mu", "mu"), ("mu_star", "mu_star"), ("sigma", "sigma")):
        expected = scale * np.asarray(oracle[theirs], dtype=np.float64)
        np.testing.assert_allclose(found[ours].value[0], expected, rtol=1e-10, atol=1e-12)


def test_a_failed_point_costs_the_effects_of_its_two_moves() -> None:
    points = trajectories(12)
    values = points.sum(axis=-1)[..., None]
    values[7, 2] = np.nan
    estimator = MorrisEstimator(sampling="trajectories", seed=SEED, factors=K, outputs=1)
    estimator.add_rows(range(12), values)
    (_, after), _ = legs(points[7])
    lost = (after == 2) | (after == 3)
    assert np.array_equal(estimator.effects[0], np.where(lost, 11, 12))
    np.testing.assert_allclose(estimator.indices()["mu"].value, 1.0, rtol=1e-12)


def test_a_study_of_trajectories_is_analysed_as_any_other() -> None:
    plan = study_plan("morris", rows=20, sampling="trajectories")
    factors = analyse(plan, results_of(plan))["outputs"]["y"]["factors"]
    assert list(factors) == list(FACTORS)
    assert all(entry["mu_star"]["low"] < entry["mu_star"]["high"] for entry in factors.values())


def test_only_elementary_effects_have_trajectories() -> None:
    assert "trajectories" in samplings("morris")
    with pytest.raises(ValueError, match="unknown sampling 'trajectories' of saltelli: expected"):
        unit_row("saltelli", "trajectories", 1, 0, 3)
