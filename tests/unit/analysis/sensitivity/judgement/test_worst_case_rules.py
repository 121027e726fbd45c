"""Bounds under the worst case, worked out by hand from ten rows; the estimator is its sums."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.designs.radial import SMALLEST_STEP
from analysis.designs.trajectories import STEP
from analysis.sensitivity.estimators import Estimate
from analysis.sensitivity.judgement.worst_case import worst_case

LEVEL = 0.8


@dataclass
class Sums:
    """Ten rows of which 18 of 20 independent runs are there; values of 0 to 1 with mean 0.4."""

    method: str
    sampling: str = "owen_blocks"
    rows: int = 10
    lowest: float = 0.0
    highest: float = 1.0
    mean: float = 0.4

    @property
    def least(self) -> Any:
        return np.array([self.lowest])

    @property
    def most(self) -> Any:
        return np.array([self.highest])

    def moments(self) -> Any:
        return SimpleNamespace(mean=np.array([self.mean]))

    def independent_runs(self) -> Any:
        return np.array([18])


@dataclass
class Index:
    """An index of factors of which all rows and eight of ten are there; a variance of 2."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    n: Any = None
    whole: Any = None

    def __post_init__(self) -> None:
        self.n = np.array([[10, *[8] * (len(self.low) - 1)]])
        self.whole = np.full((9, 1, 1), 7.0)
        self.whole[0] = 2.0

    def estimate(self, level: float) -> Estimate:
        assert level == LEVEL
        low, high = np.array([self.low]), np.array([self.high])
        return Estimate(value=0.5 * (low + high), low=low, high=high)


def bounds(sums: Sums, **indices: Index) -> dict[str, Estimate]:
    return worst_case(sums, indices, LEVEL)  # type: ignore[arg-type]


def test_shares_are_bounded_by_the_range_the_farthest_value_and_the_variance_that_is_lost() -> None:
    # Of the variance of 2 a tenth is lost: it is 1.8, or with 0.1 * 0.6 ** 2 at most 1.836.
    total = Index(low=(0.4, 0.4, 0.0), high=(0.6, 0.6, 1.4))
    first = Index(low=(0.4, 0.4, 0.02, -0.1), high=(0.6, 0.6, 1.3, 0.6))
    found = bounds(Sums("saltelli"), total_order=total, first_order=first)
    assert [*found] == ["total_order", "first_order"]
    low, high = found["total_order"].low[0], found["total_order"].high[0]
    np.testing.assert_allclose(low, [0.8 / 1.836, 0.64 / 1.836, 0.0])
    np.testing.assert_allclose(high, [1.2 / 1.8, (0.96 + 0.5 * 0.2) / 1.8, (2.24 + 0.1) / 1.8])
    low, high = found["first_order"].low[0], found["first_order"].high[0]
    # Two rows of ten hide 0.2 * 0.6 of the covariance; no share is proved to be below 0 by that.
    np.testing.assert_allclose(low, [0.8 / 1.836, (0.64 - 0.12) / 1.836, 0.0, -0.1])
    np.testing.assert_allclose(high, [1.2 / 1.8, (0.96 + 0.12) / 1.8, 1.0, (0.96 + 0.12) / 1.8])
    np.testing.assert_allclose(found["total_order"].value, [[0.5, 0.5, 0.7]])


def test_no_share_is_bounded_above_one_unless_its_interval_is() -> None:
    total = Index(low=(0.1, 0.1, 0.1), high=(0.95, 0.95, 1.2))
    far = Sums("saltelli", lowest=-3.0, highest=1.0)
    first = Index(low=(0.1, -0.05), high=(0.9, 0.9))
    found = bounds(far, total_order=total, first_order=first)
    np.testing.assert_allclose(found["total_order"].high, [[1.0, 1.0, 1.2]])
    np.testing.assert_allclose(found["first_order"].high, [[1.0, 1.0]])
    # The farthest value is 3.4 from the mean: the variance may be 1.8 + 0.1 * 3.4 ** 2.
    np.testing.assert_allclose(found["total_order"].low[0, 0], 0.2 / (1.8 + 1.156))
    np.testing.assert_allclose(found["first_order"].low, [[0.2 / (1.8 + 1.156), -0.05]])


@pytest.mark.parametrize(
    ("sampling", "step"),
    [("trajectories", STEP), ("random_trajectories", STEP), ("owen_blocks", SMALLEST_STEP)],
)
def test_a_hidden_effect_is_the_range_over_the_smallest_step_at_most(
    sampling: str, step: float
) -> None:
    mu, mu_star = Index(low=(-1.0, -1.0), high=(2.0, 2.0)), Index(low=(1.0, 1.0), high=(2.5, 2.5))
    sigma = Index(low=(0.5, 0.5), high=(0.75, 0.75))
    found = bounds(Sums("morris", sampling), mu=mu, mu_star=mu_star, sigma=sigma)
    hidden = 0.2 / step
    np.testing.assert_allclose(found["mu"].low, [[-1.0, -0.8 - hidden]])
    np.testing.assert_allclose(found["mu"].high, [[2.0, 1.6 + hidden]])
    np.testing.assert_allclose(found["mu_star"].low, [[1.0, 0.8]])
    np.testing.assert_allclose(found["mu_star"].high, [[2.5, 2.0 + hidden]])
    np.testing.assert_allclose(found["sigma"].low, [[0.5, 0.8**0.5 * 0.5]])
    squares = 0.75**2 + 2.5**2
    most = (0.8 * squares + 0.2 / step**2) ** 0.5
    np.testing.assert_allclose(found["sigma"].high, [[0.75, most]])


def test_of_effects_that_share_out_runs_and_of_nothing_seen_nothing_is_bounded() -> None:
    assert bounds(Sums("shapley")) == {}
    unseen = Sums("morris", lowest=np.inf, highest=-np.inf, mean=np.nan, rows=0)
    effects = Index(low=(0.0, 0.0), high=(1.0, 1.0))
    found = bounds(unseen, mu=effects, mu_star=effects, sigma=effects)
    assert np.isnan(found["mu"].high).all()


def test_what_a_hidden_run_adds_grows_with_the_square_of_the_range() -> None:
    total = Index(low=(0.4, 0.4), high=(0.6, 0.6))
    wide = Sums("saltelli", lowest=-0.5, highest=1.5)
    found = bounds(wide, total_order=total, first_order=total)["total_order"]
    np.testing.assert_allclose(found.high[0, 1], (0.96 + 0.5 * 0.2 * 2.0**2) / 1.8)
