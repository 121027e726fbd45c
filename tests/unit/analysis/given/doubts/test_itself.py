"""An output that stands among the factors is named, and a factor that does nearly all is not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import rankdata

from analysis.given.answer import analyse
from analysis.given.doubts.itself import itself
from tests.testbed.given import ishigami, written


@pytest.mark.parametrize(
    ("again", "said"),
    [
        (lambda y, rng: np.round(1000.0 * y), "is a straight line of c, "),
        (lambda y, rng: 32.0 + 1.8 * y, "is a straight line of c, "),
        (lambda y, rng: y + rng.normal(size=200), ""),
        (lambda y, rng: np.exp(y), "rises with c from row to row without one exception"),
        (lambda y, rng: -(y**3), "falls with c from row to row without one exception"),
    ],
)
def test_an_output_that_stands_among_the_factors_in_another_unit_is_named(
    again: Any, said: str, tmp_path: Path
) -> None:
    """Its share was 1.000, without a remark; of its exponential, all others' were 0."""
    rng = np.random.default_rng(2)
    x = rng.random((200, 2))
    y = x @ [3.0, 1.0]
    table = np.column_stack([x, again(y, rng), y])
    remarks = analyse(written(tmp_path / "runs.csv", table), ["y"])["remarks"]
    told = [one for one in remarks if one.startswith("y ") and " c" in one]
    assert len(told) == bool(said) and all(said in one for one in told)


def grades(y: Any, rng: Any) -> Any:
    return np.floor(10.0 * (rankdata(y) - 0.5) / len(y))


@pytest.mark.parametrize(
    "again",
    [
        lambda y, rng: np.round(y / y.std()),
        grades,
        lambda y, rng: -y + 0.01 * y.std() * rng.normal(size=len(y)),
    ],
)
@pytest.mark.parametrize("function", [ishigami, lambda x: np.exp(x @ [3.0, 1.0, 0.0])])
def test_an_output_that_stands_among_the_factors_rounded_or_with_noise_is_named(
    function: Any, again: Any, tmp_path: Path
) -> None:
    """Its share was 0.99 and more, and all that was said is that factors depend on each other."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        x = rng.random((200, 3))
        y = function(x)
        table = np.column_stack([x, again(y, rng), y])
        remarks = analyse(written(tmp_path / "r.csv", table, "a,b,c,again,y"), ["y"])["remarks"]
        (said,) = [one for one in remarks if "have y in the order of again" in one]
        assert "goes with a and b as well" in said and "--factor" in said


def test_a_factor_that_does_nearly_all_is_not_taken_for_the_output() -> None:
    """Whether it is independent of the others, or one of them goes with it."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        x = rng.random((200, 4))
        x[:, 3] = rng.integers(0, 5, 200)
        pairs = [(0, 2)] if seed % 2 else []
        if pairs:
            x[:, 0] = x[:, 2] + 0.5 * rng.random(200)
        for lead in (2, 3):
            y = 20.0 * x[:, lead] + x.sum(axis=1) + 0.1 * rng.normal(size=200)
            assert itself("y", y, "abcd", x, pairs) == []


def test_of_rows_that_are_not_drawn_only_the_output_itself_is_named() -> None:
    rng = np.random.default_rng(1)
    x = rng.random((200, 2))
    table = np.column_stack([x, grades(x.sum(axis=1), rng)])
    assert itself("y", x.sum(axis=1), "abc", table) == []
    assert itself("y", x.sum(axis=1), "abc", table, [(0, 2), (1, 2)]) != []
    # Of more factors than rows allow functions of, nothing is told.
    assert itself("y", x[:, 0], [str(f) for f in range(62)], rng.random((200, 62)), []) == []
