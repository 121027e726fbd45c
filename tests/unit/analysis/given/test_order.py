"""Rows of a chain are told from rows that were drawn, laid out or sorted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.given.answer import analyse
from analysis.given.order import chain
from tests.testbed.given import written


def autoregressive(rng: Any, rows: int = 200, factors: int = 2, keeps: float = 0.9) -> Any:
    x = rng.normal(size=(rows, factors))
    for row in range(1, rows):
        x[row] = keeps * x[row - 1] + np.sqrt(1.0 - keeps**2) * x[row]
    return x


def walk(rng: Any, rows: int = 300) -> Any:
    """Return a Metropolis chain in the unit cube, as a sampler of a posterior makes it."""
    points = [np.full(3, 0.5)]
    while len(points) < rows:
        tried = points[-1] + 0.12 * rng.normal(size=3)
        points += [tried] if ((tried > 0.0) & (tried < 1.0)).all() else []
    return np.stack(points)


def jittered(rng: Any, each: int = 7, factors: int = 3) -> Any:
    levels = np.stack(np.meshgrid(*[np.arange(float(each))] * factors), axis=-1)
    levels = levels.reshape(-1, factors)
    return levels + rng.random(levels.shape)


def found(x: Any) -> bool:
    return chain(x, x.sum(axis=1, keepdims=True)) is not None


@pytest.mark.parametrize("rows", [autoregressive, walk])
def test_rows_of_a_chain_are_found(rows: Any) -> None:
    """Of 60 tables of such rows 59 had no remark."""
    for seed in range(10):
        x = rows(np.random.default_rng(seed))
        assert found(x)
        assert not found(np.random.default_rng(seed).permutation(x))


@pytest.mark.parametrize(
    "rows",
    [
        lambda rng: rng.random((200, 10)),
        lambda rng: qmc.LatinHypercube(5, rng=rng).random(200),
        lambda rng: qmc.Sobol(5, rng=rng).random(256),
        lambda rng: qmc.Sobol(4, scramble=False).random(2048)[1::7],
        lambda rng: qmc.Halton(4, rng=rng).random(300),
        lambda rng: (np.outer(np.arange(257), [1.0, 17.0, 32.0]) / 257.0 + rng.random(3)) % 1.0,
        jittered,
        lambda rng: jittered(rng, 3, 5),
        lambda rng: np.sort(rng.random((200, 1)), axis=0) + rng.random((200, 3)) * [0.0, 1.0, 1.0],
        # Sorted by a factor within each value of one that is not here.
        lambda rng: np.column_stack([np.sort(rng.random((5, 40))).ravel(), rng.random(200)]),
        lambda rng: (x := rng.random((200, 3)))[np.argsort(x.sum(axis=1))],
    ],
)
def test_rows_that_were_drawn_laid_out_or_sorted_are_no_chain(rows: Any) -> None:
    for seed in range(20):
        assert not found(rows(np.random.default_rng(seed)))


def test_as_many_rows_are_told_as_would_tell_as_much() -> None:
    x = autoregressive(np.random.default_rng(1), rows=20_000)
    one = chain(x, x[:, :1])
    assert one is not None and one.rows == pytest.approx(20_000 * 0.19 / 1.81, rel=0.1)


def test_an_answer_names_the_factors_of_a_chain(tmp_path: Path) -> None:
    x = autoregressive(np.random.default_rng(3))
    x[:, 1] = np.random.default_rng(4).random(200)
    table = np.c_[x, x.sum(axis=1)]
    remarks = " ".join(analyse(written(tmp_path / "x.csv", table, "a,b,y"), ["y"])["remarks"])
    assert (
        "Rows go on from the row before" in remarks and "(rank correlation with it: a (+" in remarks
    )
