"""Waves, jumps and codes that first-order shares do not follow are named; what they do is not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.given.answer import analyse
from analysis.given.doubts.waves import missed
from tests.testbed.given import ishigami, written


def of_codes(x: Any) -> Any:
    return np.random.default_rng(7).normal(size=50)[np.floor(50.0 * x[:, 0]).astype(int)] + x[:, 1]


def of_waves(x: Any) -> Any:
    return np.sin(30.0 * np.pi * x[:, 0]) + x[:, 1]


@pytest.mark.parametrize(
    ("output", "coded", "said"),
    [
        # The means of 50 codes explain 0.90, and 0.21 was told.
        (of_codes, True, "If its 50 values are codes, whose order means nothing, their means"),
        (of_waves, False, "y has more waves or jumps with a than rbd_fast and hdmr follow"),
    ],
)
def test_a_factor_that_shares_do_not_follow_is_named(output: Any, coded: bool, said: str) -> None:
    for seed in range(20):
        x = np.random.default_rng(seed).random((400, 3))
        x[:, 0] = np.floor(50.0 * x[:, 0]) / 50.0 + 1e-3 if coded else x[:, 0]
        (one,) = missed("y", output(x), "abc", x).values()
        assert said in one and "by 0." in one


@pytest.mark.parametrize(
    "output",
    [
        ishigami,
        lambda x: x[:, 0],
        lambda x: np.exp(5.0 * x[:, 0]) + x[:, 1],
        lambda x: np.prod(x - 0.5, axis=1),
        lambda x: (x[:, 0] > 0.5) + x[:, 1],
        lambda x: np.random.default_rng(int(1e6 * x[0, 0])).normal(size=len(x)),
    ],
)
def test_of_what_shares_follow_and_of_noise_nothing_is_said(output: Any) -> None:
    named = 0
    for seed in range(40):
        x = np.random.default_rng(seed).random((300, 3))
        named += bool(missed("y", output(x), "abc", x))
    assert named <= 1


@pytest.mark.parametrize("waves", [4, 5, 6])
def test_a_few_waves_are_named_that_one_measure_follows_less_than_the_other(
    waves: int, tmp_path: Path
) -> None:
    """Splines told 0.46 of 0.86, and harmonics 0.60, without a remark."""
    x = np.random.default_rng(waves).random((500, 3))
    y = np.sin(2.0 * waves * np.pi * x[:, 0]) + x[:, 1]
    remarks = analyse(written(tmp_path / "x.csv", np.c_[x, y]), ["y"])["remarks"]
    assert any("waves or jumps with" in one and " a " in one for one in remarks)


def test_of_twenty_one_values_or_fewer_the_means_follow_any_order() -> None:
    rng = np.random.default_rng(2)
    x = rng.integers(0, 21, (400, 2)).astype(float)
    assert missed("y", rng.normal(size=21)[x[:, 0].astype(int)], "ab", x) == {}


def test_an_answer_names_waves_of_rows_that_were_drawn(tmp_path: Path) -> None:
    x = np.random.default_rng(1).random((300, 3))
    found = analyse(written(tmp_path / "x.csv", np.c_[x, of_waves(x)]), ["y"])
    assert any(remark.startswith("y has more waves") for remark in found["remarks"])
