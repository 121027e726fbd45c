"""What Morris's trajectories promise: his design, even or spread wide, and SALib's effects."""

from itertools import product

import numpy as np
import pytest
from SALib.analyze import morris as salib_morris

from analysis.designs import samplings, unit_row, unit_rows
from analysis.designs.radial import legs
from analysis.designs.trajectories import (
    CHOSEN,
    LEVELS,
    STEP,
    TRAJECTORIES,
    distances,
    far_apart,
)
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.judgement.trust import judge
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan

SEED, K = 4, 5


Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def trajectories(rows: int, seed: int = SEED, sampling: str = "trajectories") -> Array:
    return unit_rows("morris", sampling, seed, range(rows), K)


@pytest.mark.parametrize("sampling", TRAJECTORIES)
def test_each_step_moves_one_factor_by_half_its_levels_and_each_factor_once(sampling: str) -> None:
    points = trajectories(30, sampling=sampling)
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
    expected = [
        [0.875, 0.375, 0.125],
        [0.875, 0.875, 0.125],
        [0.375, 0.875, 0.125],
        [0.375, 0.875, 0.625],
    ]
    assert unit_row("morris", "random_trajectories", 1, 13, 3).tolist() == expected


def test_legs_are_the_moves_of_the_row() -> None:
    for points in trajectories(10):
        (before, after), steps = legs(points)
        assert np.array_equal(after, before + 1)
        for factor in range(K):
            move = points[after[factor]] - points[before[factor]]
            assert np.flatnonzero(move).tolist() == [factor]
            assert move[factor] == steps[factor]


def test_levels_and_orders_are_drawn_evenly() -> None:
    """Of 1000 rows a share of 1/4 errs by 0.014."""
    points = trajectories(1000, sampling="random_trajectories")
    for level in (0.125, 0.375, 0.625, 0.875):
        for position in (0, K):
            share = np.mean(points[:, position] == level, axis=0)
            np.testing.assert_allclose(share, 1.0 / LEVELS, atol=0.05)
    assert len(np.unique(points[:, 0], axis=0)) > 0.5 * LEVELS**K
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


@pytest.mark.parametrize("sampling", TRAJECTORIES)
def test_effects_are_salibs(sampling: str) -> None:
    """SALib divides by 2/3, the step of levels that are ends; here levels are middles."""
    points = trajectories(20, sampling=sampling)
    values = points[..., 0] + 3.0 * points[..., 1] * points[..., 2] + np.sin(4.0 * points[..., 3])
    problem = {"num_vars": K, "names": list("abcde"), "bounds": [[0.0, 1.0]] * K}
    oracle = salib_morris.analyze(
        problem, points.reshape(-1, K), values.ravel(), num_levels=LEVELS, num_resamples=2
    )
    estimator = MorrisEstimator(sampling=sampling, seed=SEED, factors=K, outputs=1)
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


def interacting(points: Array) -> Array:
    u, c = points, points - 0.5
    return np.stack([u[..., 0] * (1 + 8 * c[..., 1] ** 2), c[..., 2] * c[..., 3] + u[..., 4]], -1)


def test_effects_of_factors_that_interact_are_those_of_even_levels_and_held_as_often_as_said() -> (
    None
):
    """Nine of ten times, of 50 studies: the mean of 30 such shares errs by less than 0.03."""
    grid = np.array(list(product([0.125, 0.375, 0.625, 0.875], repeat=K)))
    held = {"mu": 0.0, "mu_star": 0.0, "sigma": 0.0}
    truth = np.empty((3, 2, K))
    for factor in range(K):
        low = grid[grid[:, factor] < STEP]
        effects = (interacting(low + STEP * np.eye(K)[factor]) - interacting(low)) / STEP
        truth[:, :, factor] = effects.mean(0), np.abs(effects).mean(0), effects.std(0)
    for seed in range(50):
        points = trajectories(128, seed, "random_trajectories")
        estimator = MorrisEstimator(sampling="random_trajectories", seed=seed, factors=K, outputs=2)
        estimator.add_rows(range(128), interacting(points))
        found = estimator.indices()
        for index, true in zip(held, truth, strict=True):
            moves = truth[2] > 1e-9
            inside = (found[index].low <= true) & (true <= found[index].high)
            held[index] += inside[moves].mean() / 50
    assert all(0.84 < share < 0.97 for share in held.values()), held


@pytest.mark.parametrize(("rows", "trusted"), [(40, None), (160, False)])
def test_a_study_of_trajectories_that_lie_far_apart_says_that_its_levels_are_not_even(
    rows: int, trusted: bool | None
) -> None:
    for sampling in TRAJECTORIES:
        points = trajectories(rows, sampling=sampling)
        estimator = MorrisEstimator(sampling=sampling, seed=SEED, factors=K, outputs=2)
        estimator.add_rows(range(rows), interacting(points))
        trust = judge(estimator, estimator.statistics(), 0, "y")
        said = "those of sampling random_trajectories are." in trust.sentence
        assert said is (sampling == "trajectories")
        assert trust.trusted is (trusted if said else None if rows < 128 else True)
        assert ("not to be believed yet" in trust.sentence) is (rows < 128)


def test_only_elementary_effects_have_trajectories() -> None:
    assert set(TRAJECTORIES) < set(samplings("morris"))
    with pytest.raises(ValueError, match="unknown sampling 'trajectories' of saltelli: expected"):
        unit_row("saltelli", "trajectories", 1, 0, 3)
