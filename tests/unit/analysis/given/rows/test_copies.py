"""Rows that are copies of others are told from rows that are equal by chance."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from analysis.given.answer import analyse
from analysis.given.rows.copies import without_copies
from analysis.given.table.refusals import GivenError
from tests.testbed.given import written


def unequal(rng: Any, rows: int) -> Any:
    """Return three factors of few values, some of them rare."""
    chances = [0.8, 0.1, 0.1], [0.7, 0.3], [0.6, 0.3, 0.1]
    return np.stack([rng.choice(len(p), rows, p=p) for p in chances], axis=1).astype(float)


def depending(rng: Any, rows: int) -> Any:
    normal = np.sqrt(0.9) * rng.normal(size=(rows, 1)) + np.sqrt(0.1) * rng.normal(size=(rows, 5))
    return np.floor(8.0 * ndtr(normal))


def weighed(x: Any) -> Any:
    return (x @ (1.0 + np.arange(x.shape[1])) ** 2)[:, None]


@pytest.mark.parametrize(
    "drawn",
    [
        unequal,
        depending,
        lambda rng, rows: rng.integers(0, 10, (rows, 1)).astype(float),
        lambda rng, rows: rng.integers(0, 2, (rows, 10)).astype(float),
    ],
)
def test_drawn_rows_of_few_values_are_kept_whatever_their_output(drawn: Callable[..., Any]) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = drawn(rng, 400)
        noise = rng.normal(size=(400, 1))
        for y in (weighed(x), weighed(x) + noise, (noise > 0.0).astype(float)):
            assert len(without_copies(x, y)) == 400


def test_copies_are_dropped_of_values_that_hardly_repeat() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = rng.random((200, 3))
        mixed = np.column_stack([x[:, 0], x[:, 1] < 0.5])
        for one in (x, mixed):
            for more in (one[:1], one[:20], one[rng.integers(0, 200, 80)]):
                table = np.concatenate([one, more])
                assert without_copies(table, weighed(table)).tolist() == list(range(200))


@pytest.mark.parametrize("rows", [0, 3])
def test_of_rows_without_factors_all_are_kept(rows: int) -> None:
    assert without_copies(np.full((rows, 2), np.nan), np.ones((rows, 1))).tolist() == [*range(rows)]


def test_a_table_of_few_values_that_stands_there_twice_is_halved() -> None:
    x = unequal(np.random.default_rng(3), 400)
    rows = without_copies(np.tile(x, (2, 1)), np.tile(weighed(x), (2, 1)))
    assert rows.tolist() == list(range(400))
    each = without_copies(np.repeat(x, 3, axis=0), np.repeat(weighed(x), 3, axis=0))
    assert len(each) == 400
    assert sorted(np.repeat(x, 3, axis=0)[each].tolist()) == sorted(x.tolist())


def test_copies_of_rows_with_few_values_are_dropped_if_chance_makes_far_fewer() -> None:
    rng = np.random.default_rng(3)
    many = rng.integers(0, 8, (500, 6)).astype(float)
    assert len(without_copies(*(np.concatenate([t, t[:50]]) for t in (many, weighed(many))))) <= 500
    x, noise = unequal(rng, 200), rng.normal(size=(200, 1))
    assert len(without_copies(*(np.concatenate([t, t[:20]]) for t in (x, noise)))) == 200


def test_shares_of_factors_of_few_values_are_those_of_their_distribution(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    x = unequal(rng, 2000)
    y = x[:, 0] * (1.0 + x[:, 1]) + x[:, 1]
    found = analyse(written(tmp_path / "few.csv", np.column_stack([x, y])), ["y"])
    assert found["rows_used"] == 2000
    means = [y[x[:, 0] == level].mean() for level in x[:, 0]]
    share = found["outputs"]["y"]["measures"]["hdmr"]["a"]
    assert share["low"] <= np.var(means) / np.var(y) <= share["high"]
    with pytest.raises(GivenError, match="it has 40 different rows"):
        table = np.tile(rng.random((40, 4)), (3, 1))
        analyse(written(tmp_path / "copies.csv", table), ["y"])


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_rows_that_are_equal_where_values_pile_up_are_kept(noise: float) -> None:
    """Three in ten of two factors were zero, and of what they did together nothing was left."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = np.maximum(0.0, rng.random((300, 2)) - 0.3)
        y = x.sum(axis=1, keepdims=True)
        y = np.maximum(0.0, y + noise * rng.normal(size=y.shape) - 0.2)
        assert len(without_copies(x, y)) == 300


def test_copies_are_dropped_beside_values_that_pile_up() -> None:
    """Not those of the rows that many have, of which nobody knows."""
    rng = np.random.default_rng(1)
    x = np.maximum(0.0, rng.random((300, 2)) - 0.3)
    table = np.concatenate([x, x[:40]])
    kept = without_copies(table, weighed(table))
    assert kept.tolist() == [*range(300), *(300 + np.flatnonzero((x[:40] == 0.0).all(axis=1)))]


def test_all_combinations_of_few_values_may_stand_there_as_often_as_one_likes() -> None:
    """Four switches from 256 of Sobol's points were refused as 16 different rows."""
    x = np.stack(np.meshgrid(*[[0.0, 1.0]] * 4), axis=-1).reshape(-1, 4)
    table = np.tile(x, (16, 1))
    assert len(without_copies(table, weighed(table))) == 256
    # Of so many that indices need no more, a second time tells nothing new.
    many = np.tile(np.stack(np.meshgrid(*[[0.0, 1.0, 2.0, 3.0]] * 3), -1).reshape(-1, 3), (8, 1))
    assert len(without_copies(many, weighed(many))) == 64
