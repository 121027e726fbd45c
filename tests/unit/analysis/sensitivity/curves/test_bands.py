"""What bands of curves promise: all points at once, but for those where few runs count."""

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.designs import unit_rows
from analysis.sensitivity.curves.bands import band_level, least_half
from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.curves.findings import findings
from analysis.sensitivity.estimators.intervals import student
from analysis.sensitivity.remarks import remarks
from models.curves import Curve

Array = NDArray[np.float64]


def studied(blocks: Array) -> tuple[Array, Array, Array]:
    """Return the means of eight blocks, those without each, and replicates of variance 1 / 8."""
    mean = blocks.mean(axis=0)
    replicates = mean + np.random.default_rng(3).normal(size=(64, len(mean))) / 8.0**0.5
    return mean, (8.0 * mean - blocks) / 7.0, replicates


@pytest.mark.parametrize("skewed", [False, True])
def test_a_band_of_many_independent_points_holds_them_all_though_some_blocks_agree_by_chance(
    skewed: bool,
) -> None:
    """By the blocks alone it was held in 0.86 of such studies, and in 0.23 of skewed errors."""
    rng = np.random.default_rng(5)
    there = np.ones((8, 60), dtype=bool)
    held = np.zeros(2)
    for _ in range(100):
        drawn = rng.exponential(size=(8, 60)) - 1.0 if skewed else rng.normal(size=(8, 60))
        mean, without, replicates = studied(drawn)
        level = band_level(without, there, 0.9)
        blocks = student(mean, without, there, level).high - mean
        least = least_half(without, there, replicates, level)
        reached = np.stack([blocks, np.maximum(blocks, least)])
        held += np.all(np.abs(mean) <= reached, axis=1) / 100
    assert held[1] > (0.7 if skewed else 0.9)
    assert held[1] > held[0] + 0.05


def test_a_band_leans_on_other_points_as_far_as_these_are_alike() -> None:
    rng = np.random.default_rng(8)
    there = np.ones((8, 40), dtype=bool)
    _, without, replicates = studied(rng.normal(size=(8, 40)))
    without[:, 0] = without[:, 0].mean() + 0.01 * (without[:, 0] - without[:, 0].mean())
    alone = student(without[0], without, there, 0.9).high - without[0]
    least = least_half(without, there, replicates, 0.9)
    assert least[0] > 20.0 * alone[0]
    # If Sobol points gain a hundredfold at some points and nothing at others, none tells others'.
    scale = np.where(np.arange(40) % 2, 1.0, 0.01)
    middle = without.mean(axis=0)
    unlike = middle + scale * (without - middle)
    assert np.median(least_half(unlike, there, replicates, 0.9)[::2] / alone[::2]) < 0.02
    assert least_half(without[:, :2], there[:, :2], replicates[:, :2], 0.9).tolist() == [0.0, 0.0]


def test_points_whose_variance_few_runs_make_up_are_named_and_counted() -> None:
    """A pulse that moves seldom reaches the ends of its line."""
    places = np.linspace(0.0, 1.0, 21)
    points = unit_rows("saltelli", "owen_blocks", 5, range(128), 2)
    at, wide = 0.2 + 0.6 * points[..., :1], 0.05 + 0.1 * points[..., 1:]
    values = np.exp(-(((places - at) / wide) ** 2))
    curve = CurveEstimator(method="saltelli", sampling="owen_blocks", seed=5, factors=2, points=21)
    curve.add_rows(range(100), values[:100])
    of = Curve(points=21, over="time")
    assert findings("y", of, curve, ["a", "b"], 0.9)["on_few_runs"] == []
    curve.add_rows(range(100, 128), values[100:])
    said = findings("y", of, curve, ["a", "b"], 0.9)
    named = np.array(said["on_few_runs"]) * 20.0 / said["axis"][-1]
    assert {0, 20} <= set(named.round()) and not {8, 9, 10, 11, 12} & set(named.round())
    assert said["trust"]["trusted"]
    snapshot = {"outputs": {}, "curves": {"y": said}, "rows_used": 128}
    counted = f"At {len(named)} of 21 points of y few runs make up the variance: intervals and"
    assert any(one.startswith(counted) for one in remarks(snapshot, "y"))
