"""Rows that share several values of others are told from rows that were drawn."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.given.answer import analyse
from analysis.given.rows.groups import in_trajectories, together
from tests.testbed.given import written


def crossed(rng: Any) -> Any:
    one, other = rng.random((2, 20, 2))
    return np.column_stack([np.repeat(one, 20, axis=0), np.tile(other, (20, 1))])


def nested(rng: Any) -> Any:
    return np.column_stack([np.repeat(rng.random((80, 2)), 3, axis=0), rng.random((240, 2))])


def in_groups(rng: Any, rows: int = 64) -> Any:
    """Return Saltelli's design of three groups of two factors."""
    a, b = rng.random((2, rows, 6))
    points = [a, b]
    for group in (slice(0, 2), slice(2, 4), slice(4, 6)):
        points.append(a.copy())
        points[-1][:, group] = b[:, group]
    return np.stack(points, axis=1).reshape(-1, 6)


@pytest.mark.parametrize(
    ("laid_out", "groups"),
    [
        (crossed, [[0, 1], [2, 3]]),
        (nested, [[0, 1]]),
        # All that is not moved stays together.
        (in_groups, [[0, 1, 2, 3, 4, 5]]),
    ],
)
def test_factors_that_repeat_together_are_found_in_whatever_order_rows_come(
    laid_out: Any, groups: Any
) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = laid_out(rng)
        assert together(x) == together(rng.permutation(x)) == groups


def rounded_copies(rng: Any) -> Any:
    x = np.round(rng.uniform(10.0, 20.0, 300), 1)
    return np.column_stack([x, np.round(x / 25.4, 2), rng.random(300)])


def category(rng: Any) -> Any:
    return np.column_stack([np.eye(5)[rng.integers(0, 5, 300)], rng.random(300)])


@pytest.mark.parametrize(
    "drawn",
    [
        lambda rng: rng.random((300, 4)),
        lambda rng: np.round(rng.random((400, 4)), 1),
        lambda rng: np.round(rng.normal(size=(400, 3)), 1),
        lambda rng: rng.integers(0, 20, (400, 3)).astype(float),
        lambda rng: np.maximum(0.0, rng.random((300, 3)) - 0.6),
        lambda rng: np.floor(20.0 * qmc.LatinHypercube(3, rng=rng).random(400)),
        lambda rng: np.round(qmc.Sobol(4, rng=rng).random(256), 2),
        lambda rng: np.stack(np.meshgrid(*[np.arange(12.0)] * 2), axis=-1).reshape(-1, 2),
        rounded_copies,
        category,
    ],
)
def test_rows_that_were_drawn_have_no_such_factors(drawn: Any) -> None:
    for seed in range(10):
        x = drawn(np.random.default_rng(seed))
        assert together(x) == [] and in_trajectories(x) == 0


@pytest.mark.parametrize(
    ("laid_out", "said", "used"),
    [
        (crossed, "(a, b; c, d), as where settings are crossed or nested, or a", 400),
        (nested, "80 of 240 rows share none, and the others are no draws of their own", 80),
    ],
)
def test_only_rows_that_share_nothing_are_used_if_they_are_enough(
    laid_out: Any, said: str, used: int, tmp_path: Path
) -> None:
    """Intervals held the shares of crossed settings in half of the tables, without a remark."""
    x = laid_out(np.random.default_rng(3))
    found = analyse(written(tmp_path / "x.csv", np.c_[x, x.sum(axis=1)], "a,b,c,d,y"), ["y"])
    assert said in " ".join(found["remarks"])
    assert found["measures"]["rbd_fast"]["rows"] == used
    assert ("Intervals are too narrow." in " ".join(found["remarks"])) == (used == len(x))


def test_walks_that_move_groups_of_factors_are_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    walks = np.repeat(rng.integers(0, 2, (40, 1, 6)) / 3.0, 4, axis=1)
    for group in range(3):
        walks[:, group + 1 :, 2 * group : 2 * group + 2] += 2.0 / 3.0
    x = walks.reshape(-1, 6)
    assert in_trajectories(x) == 4
    table = np.c_[x, x.sum(axis=1)]
    found = analyse(written(tmp_path / "walks.csv", table, "a,b,c,d,e,f,y"), ["y"])
    assert any("The sample is walks of 4 rows" in remark for remark in found["remarks"])
