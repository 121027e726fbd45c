"""Clusters of rows are found in whatever order, and rows that were drawn are none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.given.answer import analyse
from analysis.given.rows.clusters import as_few_as
from tests.testbed.given import written


def clusters(seed: int, centres: int, each: int, spread: float) -> Any:
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.random((centres, 3)), each, axis=0)
    return rng.permutation(x + spread * rng.normal(size=x.shape))


@pytest.mark.parametrize(("centres", "each", "spread"), [(200, 5, 0.02), (60, 10, 0.04)])
def test_shuffled_clusters_tell_less_than_as_many_rows(
    centres: int, each: int, spread: float
) -> None:
    """Their intervals were far too narrow, without a word."""
    for seed in range(3):
        rows = as_few_as(clusters(seed, centres, each, spread))
        assert rows is not None and centres < rows < 0.5 * centres * each


@pytest.mark.parametrize("kind", ["drawn", "heavy", "levels", "hypercube", "sequence"])
def test_rows_that_were_drawn_are_in_none(kind: str) -> None:
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = {
            "drawn": lambda rng=rng: rng.random((200, 3)),
            "heavy": lambda rng=rng: rng.pareto(1.5, (200, 3)),
            "levels": lambda rng=rng: rng.integers(0, 5, (200, 3)).astype(float),
            "hypercube": lambda seed=seed: qmc.LatinHypercube(3, seed=seed).random(200),
            "sequence": lambda seed=seed: qmc.Sobol(3, seed=seed).random(256),
        }[kind]()
        found += as_few_as(x) is not None
    assert found == 0


def test_factors_that_depend_on_each_other_make_no_clusters() -> None:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0.0, 2.0 * np.pi, 400)
    x = np.column_stack([np.cos(turn), np.sin(turn), rng.random(400)])
    assert as_few_as(x) is not None
    assert as_few_as(x, [(0, 1)]) is None
    # Nothing is left to deal.
    assert as_few_as(x[:, :2], [(0, 1)]) is None and as_few_as(x[:, :1]) is None


def test_an_answer_says_that_rows_lie_in_clusters(tmp_path: Path) -> None:
    x = clusters(1, 60, 5, 0.02)
    remarks = analyse(written(tmp_path / "x.csv", np.c_[x, x.sum(axis=1)]), ["y"])["remarks"]
    assert any(remark.startswith("Rows lie in clusters") for remark in remarks)
