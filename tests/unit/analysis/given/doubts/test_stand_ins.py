"""Numbers that stand for runs that failed are named where they matter, and rounded ones are not."""

from typing import Any

import numpy as np
import pytest

from analysis.given.doubts.stand_ins import atom


@pytest.mark.parametrize(
    ("output", "code"),
    [
        (lambda rng: rng.uniform(2.0, 10.0, 300), 0.0),
        (lambda rng: 10.0 + 2.0 * rng.normal(size=300), -1.0),
        (lambda rng: rng.uniform(0.0, 5000.0, 300), -999.0),
        (lambda rng: -rng.uniform(2.0, 10.0, 300).round(2), 0.0),
        (lambda rng: rng.uniform(0.0, 1.0, 300), 1.0),
    ],
)
def test_a_code_of_few_rows_at_an_end_of_an_output_is_named(output: Any, code: float) -> None:
    """Of six rows in 300 none was, though they made from 0.05 to 0.3 of the variance."""
    for seed in range(20):
        y = output(np.random.default_rng(seed))
        assert atom("y", y) == ""
        y[::33] = code
        assert f"y is {code:g} in 10 of 300 rows" in atom("y", y)


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_rounded_outputs_and_codes_that_do_not_matter_are_not_named(digits: int) -> None:
    """Least of all where many lie at an end, as of squares."""
    said = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        for y in (rng.random((2, 200)).sum(axis=0), rng.random(200) ** 1.5, rng.normal(size=200)):
            said += atom("y", y.round(digits)) != ""
    assert said <= 1
    few = np.random.default_rng(1).normal(size=1000)
    few[:4] = -3.5
    assert atom("y", few) == ""


def test_a_value_that_many_rows_share_is_named_wherever_it_lies() -> None:
    y = np.random.default_rng(1).normal(size=300)
    y[:15] = -0.0
    assert "y is 0 in 15 of 300 rows" in atom("y", y)
    for still in (np.repeat([1.0, 2.0], 40), np.ones(80)):
        assert atom("y", still) == ""
