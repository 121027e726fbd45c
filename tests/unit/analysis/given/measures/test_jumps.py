"""Jumps of an output with a factor, which splines and harmonics smear, are followed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from analysis.given.doubts.contradictions import apart, shares
from analysis.given.doubts.waves import missed
from analysis.given.measures.jumps import jumps
from analysis.given.measures.measure import MEASURES
from analysis.given.measures.rbd_fast import harmonics

_BY_NAME = {measure.name: measure for measure in MEASURES}


@pytest.mark.parametrize("measure", ["rbd_fast", "hdmr"])
@pytest.mark.parametrize(
    ("output", "share"),
    [
        (lambda x: (x[:, 0] > 0.5) * 1.0, 1.0),
        (lambda x: (x[:, 0] > 0.7) + 0.5 * (x[:, 1] > 0.3) * x[:, 2], 0.883),
        (lambda x: np.floor(3.0 * x[:, 0]) + x[:, 1], 0.889),
    ],
)
def test_intervals_hold_the_share_of_a_factor_with_jumps(
    output: Callable[[Any], Any], share: float, measure: str
) -> None:
    """The strangers' tables: 0.95, 0.83 and 0.85 were told, and no interval held the share."""
    held = 0
    for seed in range(12):
        x = np.random.default_rng(seed).random((300, 4))
        found = _BY_NAME[measure].estimate(x, output(x), 0.9, np.random.default_rng(1))
        held += bool(found.low[0] - 1e-3 <= share <= found.high[0] + 1e-3)
    assert held >= 8


@pytest.mark.parametrize(
    "noise",
    [
        lambda rng, u: rng.normal(size=len(u)),
        lambda rng, u: rng.standard_t(3, size=len(u)),
        lambda rng, u: (u + 0.1) * rng.exponential(size=len(u)) + u**2,
    ],
)
def test_of_noise_and_of_what_rises_no_jump_is_found(noise: Callable[..., Any]) -> None:
    basis, u = harmonics(200), np.arange(200) / 200.0
    found = 0
    for seed in range(200):
        y = noise(np.random.default_rng(seed), u)
        left = y - basis @ (basis.T @ y)
        found += bool(jumps(left, basis, u, float(np.sum((y - y.mean()) ** 2)))[0])
    assert found <= 1


def test_what_jumps_more_than_ten_times_is_waves_or_codes() -> None:
    basis, u = harmonics(1000), np.arange(1000) / 1000.0
    for times, wanted in ((3, 3), (40, 0)):
        y = np.floor((times + 1) * u) % 2 - 0.5
        left = y - basis @ (basis.T @ y)
        assert len(jumps(left, basis, u, float(y @ y))[0]) == wanted


def test_only_the_measure_is_named_that_does_not_follow() -> None:
    """Of four waves splines told 0.6 and harmonics the whole: it was said of both, or of none."""
    x = np.random.default_rng(1).random((500, 3))
    y = np.sin(8.0 * np.pi * x[:, 0]) + x[:, 1]
    (said,) = missed("y", y, "abc", x).values()
    assert said.startswith("y has more waves or jumps with a than hdmr follows: the share of it")


def test_of_few_rows_that_make_up_the_variance_no_waves_are_told() -> None:
    """A stranger's rare corner: waves were said of a factor with 0.001 of the variance."""
    for seed in range(10):
        x = np.random.default_rng(seed).random((500, 5))
        y = 10.0 * ((x[:, 0] > 0.9) & (x[:, 1] > 0.9)) + 0.1 * x[:, 2]
        assert missed("y", y, "abcde", x) == {}


def test_two_shares_of_one_factor_have_either_cause() -> None:
    told = {
        "rbd_fast": {"a": {"value": 0.0, "low": -0.05, "high": 0.05}},
        "hdmr": {"a": {"value": 0.5, "low": 0.45, "high": 0.55}},
    }
    (said,) = apart("y", shares(told), 0.9)
    assert "that tells less of it, or factors depend on each other" in said
