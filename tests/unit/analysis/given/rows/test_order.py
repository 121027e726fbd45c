"""Rows of a chain are told from rows that were drawn, laid out or sorted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.given.answer import analyse
from analysis.given.rows.order import chain, rest_in_order
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


@pytest.mark.parametrize(
    "moved",
    [
        lambda rng: np.repeat(rng.normal(size=20), 20),
        lambda rng: np.linspace(0.0, 3.0, 400),
        lambda rng: 0.1 * np.cumsum(rng.normal(size=400)),
    ],
    ids=["batches", "drift", "walk"],
)
def test_outputs_that_hang_together_from_row_to_row_are_named(moved: Any) -> None:
    """Batches that share an offset made 25 rows as good as one, without a word."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = rng.random((400, 3))
        y = x @ [3.0, 2.0, 1.0] + moved(rng)
        little = rest_in_order("y", y, "abc", rng.permutation(x))
        (said,) = rest_in_order("y", y, "abc", x) or little
        assert said.startswith("What the factors leave of y goes on from row to row")
        mixed = rng.permutation(400)
        assert rest_in_order("y", y[mixed], "abc", x[mixed]) == []


@pytest.mark.parametrize("every", [2, 5])
def test_machines_that_take_turns_are_named(every: int) -> None:
    """Of an offset on every second row, three quarters of the variance, nothing was said."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = rng.random((400, 3))
        y = x @ [3.0, 2.0, 1.0] + np.resize(1.5 * np.arange(every), 400)
        (said,) = rest_in_order("y", y, "abc", x)
        assert f"comes back every {every} rows" in said or "from row to row" in said
        mixed = rng.permutation(400)
        assert rest_in_order("y", y[mixed], "abc", x[mixed]) == []


def test_interactions_in_a_table_of_loops_are_no_turns() -> None:
    rng = np.random.default_rng(4)
    x = np.column_stack([rng.random(400), np.resize([0.0, 0.5, 1.0], 400)])
    assert rest_in_order("y", x[:, 0] * x[:, 1] ** 8, "ab", x) == []


def test_sorted_tables_and_what_is_constant_hang_together_for_no_such_reason() -> None:
    rng = np.random.default_rng(3)
    x = rng.random((300, 2))
    y = np.sin(30.0 * x[:, 0]) + x[:, 1]
    for order in (np.argsort(x[:, 0]), np.argsort(y)):
        assert rest_in_order("y", y[order], "ab", x[order]) == []
    assert rest_in_order("y", np.ones(300), "ab", x) == []


def test_an_answer_names_batches_by_the_order_of_the_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    x = rng.random((300, 3))
    y = x @ [3.0, 2.0, 1.0] + np.repeat(rng.normal(size=12), 25)
    remarks = analyse(written(tmp_path / "x.csv", np.c_[x, y]), ["y"])["remarks"]
    assert any(
        "goes on from row to row (correlation with the row before: +0." in r for r in remarks
    )
