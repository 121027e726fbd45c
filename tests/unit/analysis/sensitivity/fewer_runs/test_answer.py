"""An answer from few runs is near the truth, or says why it is not to be believed."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri

from analysis.designs import DEFAULT_SAMPLING, unit_rows
from analysis.designs.points import sobol
from analysis.sensitivity.fewer_runs.answer import Answer, answer
from analysis.sensitivity.fewer_runs.limits import FEWEST_RUNS, LEAST_RUNS, MOST_RUNS
from tests.testbed.functions.engineering import pole_in_a_corner

Array = NDArray[np.float64]
Function = Callable[[Array], Array]


@cache
def points(n: int = FEWEST_RUNS) -> Array:
    return np.stack([sobol(3, row, 3) for row in range(n)])


def said(function: Function, n: int = FEWEST_RUNS) -> Answer:
    found = answer(points(n), function(points(n)), 3)
    assert found is not None
    return found


def smooth(x: Array) -> Array:
    """a + 2 a b with a idle third factor: V(a (1 + 2 b)) = 1/3 * 13/3 - 1."""
    return x[:, 0] * (1.0 + 2.0 * x[:, 1])


def test_a_smooth_function_is_answered() -> None:
    found = said(smooth)
    assert found.doubt == "" and found.half_width < 1e-6 and found.surrogate == "polynomial chaos"
    variance = 13.0 / 9.0 - 1.0
    first, second, both = 4.0 / 12.0 / variance, 1.0 / 12.0 / variance, 4.0 / 144.0 / variance
    np.testing.assert_allclose(found.found.first_order.value, [first, second, 0.0], atol=1e-6)
    total = [first + both, second + both, 0.0]
    np.testing.assert_allclose(found.found.total_order.value, total, atol=1e-6)


def test_it_is_the_same_again_and_in_other_units() -> None:
    once, again = said(smooth, 64), said(smooth, 64)
    np.testing.assert_array_equal(once.found.total_order.low, again.found.total_order.low)
    scaled = said(lambda x: 1e6 - 1e3 * smooth(x), 64)
    np.testing.assert_allclose(
        scaled.found.total_order.value, once.found.total_order.value, atol=1e-6
    )


@pytest.mark.parametrize(("size", "offset"), [(1e-200, 0.0), (1e99, 0.0), (10.0, 1e14)])
def test_an_output_may_be_tiny_huge_or_far_from_zero(size: float, offset: float) -> None:
    found = said(lambda x: offset + size * smooth(x), 64)
    expected = said(smooth, 64).found.total_order.value
    np.testing.assert_allclose(found.found.total_order.value, expected, atol=1e-3)


def test_of_few_runs_nothing_is_believed() -> None:
    assert answer(points(LEAST_RUNS - 1), smooth(points(LEAST_RUNS - 1)), 3) is None
    assert "fewer than 256 runs" in said(smooth, 64).doubt


def test_what_never_varies_has_no_answer() -> None:
    assert answer(points(), np.full(FEWEST_RUNS, 7.1), 3) is None
    rounded = 0.1 + 3e-17 * np.round(points()[:, 0])
    assert np.ptp(rounded) > 0.0
    assert answer(points(), rounded, 3) is None
    assert answer(points(), np.full(FEWEST_RUNS, np.nan), 3) is None


def test_noise_is_not_believed() -> None:
    noise = np.random.default_rng(4).normal(size=FEWEST_RUNS)
    found = answer(points(), noise, 3)
    assert found is not None and "no surrogate predicts" in found.doubt
    assert found.half_width > 0.4


def test_a_heavy_tail_is_not_believed() -> None:
    assert "kurtosis" in said(lambda x: (1.0 - x[:, 0]) ** -0.4 + x[:, 1]).doubt


@pytest.mark.parametrize(
    ("look", "share", "doubt"),
    [
        ("beyond", 0.046, "about 5% of its variance may lie beyond the outermost runs"),
        ("beyond", 0.045, ""),
        ("between", 0.012, "about 1.2% of its variance may lie between the runs"),
        ("between", 0.01, ""),
    ],
)
def test_what_may_lie_beyond_or_between_the_runs_is_a_doubt(
    monkeypatch: pytest.MonkeyPatch, look: str, share: float, doubt: str
) -> None:
    monkeypatch.setattr(
        f"analysis.sensitivity.fewer_runs.corrected.HeldOut.{look}", lambda *_: share
    )
    found = said(smooth).doubt
    assert doubt in found and bool(doubt) is bool(found)


def test_a_pole_where_two_factors_near_their_ends_is_not_believed() -> None:
    """Held-out runs are explained to 0.999, and some ST is off by 0.05 and more."""
    hard = pole_in_a_corner(0.6, 0.3)
    x = unit_rows("surrogate", DEFAULT_SAMPLING, 60004, range(FEWEST_RUNS), hard.factors)[:, 0]
    found = answer(x, hard.function(x), 60004)
    assert found is not None and found.half_width < 0.05
    assert np.abs(found.found.total_order.value - hard.truth()[1]).max() > 0.05
    assert "two factors near their ends together" in found.doubt


def test_the_tail_of_a_normal_factor_counts_beyond_the_outermost_run() -> None:
    """Of 0.35 e^z beside slopes intervals of ST missed 0.130 by 0.033, and the study was sure."""
    slopes = np.array([1.0, 5.0, 4.0, 2.0])
    x = unit_rows("surrogate", DEFAULT_SAMPLING, 2, range(FEWEST_RUNS), 5)[:, 0]
    y = 0.35 * np.exp(ndtri(x[:, 0])) + x[:, 1:] @ slopes
    found = answer(x, y, 2, normal=[True, False, False, False, False])
    assert found is not None and found.doubt == "" and found.half_width < 0.02
    parts = np.append(0.35**2 * (np.e - 1.0) * np.e, slopes**2 / 12.0)
    np.testing.assert_allclose(found.found.total_order.value, parts / parts.sum(), atol=5e-3)


def test_few_failed_runs_are_left_out_and_many_are_not_believed() -> None:
    y = smooth(points()).copy()
    y[5] = np.nan
    found = answer(points(), y, 3)
    assert found is not None and found.doubt == "" and (found.runs, found.failed) == (256, 1)
    y[::20] = np.nan
    found = answer(points(), y, 3)
    assert found is not None and "of 256 runs failed" in found.doubt


def test_too_many_runs_are_refused() -> None:
    many = np.zeros((MOST_RUNS + 1, 3))
    with pytest.raises(ValueError, match="512 runs at most, not 513"):
        answer(many, many[:, 0], 3)
