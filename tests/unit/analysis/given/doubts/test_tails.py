"""Outputs that follow the heavy tail of a factor are named, and those that do not are not."""

from typing import Any

import numpy as np
import pytest

from analysis.given.doubts import tails


@pytest.mark.parametrize(
    ("factor", "output", "least", "most"),
    [
        # 23 of 40 tables had no remark, and their intervals of a share of 0.5 held it in 8.
        (lambda rng: rng.pareto(3.0, 200), lambda x: x, 30, 40),
        (lambda rng: np.exp(0.8 * rng.normal(size=200)), lambda x: x / 1.3, 28, 40),
        # The output is not moved by the tail.
        (lambda rng: np.exp(0.8 * rng.normal(size=200)), np.log, 0, 0),
        (lambda rng: np.exp(0.8 * rng.normal(size=200)), lambda x: 0.0 * x, 0, 0),
        # There is none.
        (lambda rng: rng.normal(size=200), lambda x: x, 0, 0),
    ],
)
def test_an_output_that_follows_the_tail_of_a_factor_is_said_to(
    factor: Any, output: Any, least: int, most: int
) -> None:
    said = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = np.column_stack([factor(rng), rng.random(200)])
        said += bool(tails.on_few_rows("y", output(x[:, 0]) + 3.0 * x[:, 1], "ab", x))
    assert least <= said <= most


def test_what_levels_off_follows_no_heavy_tail() -> None:
    """Of a reaction that saturates it was said in 12 of 12 tables."""
    for seed in range(8):
        x = 10.0 ** np.random.default_rng(seed).uniform(-3.0, 1.0, (400, 2))
        y = x[:, 0] / (x[:, 0] + 0.1) + 0.3 * x[:, 1] / (1.0 + x[:, 1])
        assert tails.on_few_rows("y", y, "ab", x) == ""
