"""Cells that are missing by chance, and those that go with a factor, are told apart."""

from typing import Any

import numpy as np
import pytest

from analysis.given.rows.missing import lacking


def table(gone: Any, rows: int = 300, seed: int = 0) -> Any:
    found = np.random.default_rng(seed).random((rows, 3))
    found[gone(found), 2] = np.nan
    return found


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        (lambda x: x[:, 0] > 0.8, "they go with high a, extreme a."),
        (lambda x: x[:, 0] < 0.2, "they go with"),
        (lambda x: abs(x[:, 1] - 0.5) < 0.1, "they go with middling b."),
        (lambda x: x[:, 0] * x[:, 1] > 0.5, "high a"),
    ],
)
def test_the_factor_is_named_that_missing_cells_go_with(gone: Any, said: str) -> None:
    """They had the same sentence as cells that are missing by chance."""
    remark = lacking("aby", table(gone))
    assert "and not by chance" in remark and said in remark


def test_by_chance_hardly_one_table_in_a_hundred_names_a_factor() -> None:
    named = 0
    for seed in range(200):
        rng = np.random.default_rng(1000 + seed)
        share = rng.uniform(0.1, 0.4)
        found = table(lambda x, rng=rng, share=share: rng.random(300) < share, seed=seed)
        named += "not by chance" in lacking("aby", found)
    assert named <= 4


def test_of_few_missing_cells_nothing_is_tested() -> None:
    remark = lacking("aby", table(lambda x: x[:, 0] > np.sort(x[:, 0])[-11]))
    assert remark.startswith("10 of 300 rows lack a cell") and remark.endswith("are too small.")
