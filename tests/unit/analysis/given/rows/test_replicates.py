"""Rows that repeat a point are one point, and rows that are equal by chance are not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.designs import unit_row
from analysis.given.answer import analyse
from analysis.given.measures.hsic import hsic
from analysis.given.measures.measure import MEASURES
from analysis.given.rows.copies import without_copies
from analysis.given.rows.replicates import at_points
from analysis.given.rows.sample import Sample
from tests.testbed.given import ishigami, written


def sample_of(x: Any, y: Any) -> Sample:
    names = tuple("abcdef"[: x.shape[1]])
    return Sample(file="runs.csv", factors=names, outputs=("y",), x=x, y=y[:, None], remarks=())


def points_of(x: Any) -> int:
    return len(at_points(sample_of(x, np.arange(len(x), dtype=float))).sample.x)


def four_times(rng: Any, jitter: float) -> Any:
    x = np.repeat(rng.random((128, 3)), 4, axis=0)
    return rng.permutation(x + jitter * rng.normal(size=x.shape))


@pytest.mark.parametrize("jitter", [0.0, 1e-9, 1e-3])
def test_repeated_points_make_no_idle_factor_matter(jitter: float) -> None:
    """As 512 rows it had p < 0.001 in a third of the tables."""
    p_values = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = four_times(rng, jitter)
        y = x[:, 0] + 0.5 * x[:, 1] + 0.03 * rng.normal(size=512)
        told = at_points(sample_of(x, y)).sample
        # Of nearly equal ones a point may be so near another that nothing lies between them.
        if jitter < 1e-3 or len(told.x) == 128:
            p_values.append(hsic(told.x, told.y[:, 0]).p_value[2])
    assert len(p_values) > 30 and np.mean(np.array(p_values) < 0.05) < 0.15
    assert min(p_values) > 1e-3


def test_intervals_of_repeated_points_hold_shares_of_their_mean() -> None:
    """Of 90 % they held 62 %, of repeats that were taken for draws."""
    (measure,) = (one for one in MEASURES if one.name == "hdmr")
    truth = np.array([0.8, 0.2, 0.0]) / (1.0 + 0.3**2 / 4.0 / (1.25 / 12.0))
    held = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = four_times(rng, 0.0)
        y = x[:, 0] + 0.5 * x[:, 1] + 0.3 * rng.normal(size=512)
        told = at_points(sample_of(x, y)).sample
        found = measure.estimate(told.x, told.y[:, 0], 0.9, rng)
        held.append((found.low <= truth) & (found.high >= truth))
    # Of 0.9 two standard errors are 0.045.
    assert 0.83 < np.mean(held) < 0.97


def test_points_with_unequal_repeats_are_averaged_which_is_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    point, often = rng.random((100, 3)), rng.integers(1, 6, 100)
    x = np.repeat(point, often, axis=0)
    y = x[:, 0] + rng.normal(size=len(x))
    y[0] = np.nan
    table = np.column_stack([x, y])
    found = analyse(written(tmp_path / "r.csv", table), ["y"])
    left = 100 - (often[0] == 1)
    assert found["points"] == left and found["rows_used"] == len(x) - 1
    (said,) = [remark for remark in found["remarks"] if "averaged" in remark]
    assert f"{len(x) - 1} rows stand at {left} points" in said
    # Of 1/12 and noise of 1 a mean of 1 to 5 rows has about half.
    assert 0.4 < float(said.split("times ")[1].rstrip(".")) < 0.65


@pytest.mark.parametrize(
    "drawn",
    [
        lambda u: u,
        lambda u: u[:, :1].round(2),
        lambda u: u.round(1),
        lambda u: np.floor(5.0 * u[:, :2]),
        lambda u: np.column_stack([u[:, 0], np.floor(5.0 * u[:, 1:3])]),
        lambda u: np.maximum(0.0, u - 0.3),
        lambda u: np.column_stack([u[:, 0], np.sin(9.0 * u[:, 0])]),
        lambda u: np.where(u[:, :1] < 0.5, 1e-4 * u, u),
        lambda u: np.exp(9.0 * u),
    ],
)
def test_drawn_points_are_no_repeats_whatever_their_values(drawn: Callable[[Any], Any]) -> None:
    for seed in range(10):
        for rows in (70, 300, 1000):
            x = drawn(np.random.default_rng(seed).random((rows, 4)))
            assert points_of(x) == rows


def test_all_combinations_of_few_values_are_no_repeats() -> None:
    crossed = np.array(list(np.ndindex(4, 4, 4)), dtype=float)
    kept = np.random.default_rng(1).random(256) < 0.95
    for x in (np.tile(crossed, (4, 1)), np.tile(crossed, (4, 1))[kept]):
        assert points_of(x) == len(x)
    assert points_of(np.repeat(np.arange(20.0), 10)[:, None]) == 200


def test_of_few_points_it_is_said_that_rows_are_taken_as_they_are() -> None:
    x = np.repeat(np.random.default_rng(1).random((30, 2)), 5, axis=0)
    told = at_points(sample_of(x, np.arange(150.0)))
    assert len(told.sample.x) == 150 and "stand at 30 points" in told.remarks[0]
    assert "too narrow" in told.remarks[0]


def test_repeats_of_an_event_are_no_copies_of_each_other() -> None:
    rng = np.random.default_rng(1)
    x = np.repeat(rng.random((100, 2)), rng.integers(2, 6, 100), axis=0)
    y = (rng.random((len(x), 1)) < x[:, :1]).astype(float)
    assert len(without_copies(x, y)) == len(x)


def test_a_design_that_is_run_twice_is_recognised_by_its_points(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for method, width in (("saltelli", 5), ("morris", 4)):
        rows = [unit_row(method, "owen_blocks", 4, row, 3) for row in range(64)]
        x = np.tile(np.concatenate(rows), (2, 1))
        table = np.column_stack([x, ishigami(x) + rng.normal(size=len(x))])
        found = analyse(written(tmp_path / "twice.csv", table), ["y"])
        assert found["design"] == {"method": method, "rows": 64, "width": width}
        assert found["points"] == 64 * width


def test_rows_that_repeat_for_want_of_a_factor_are_no_repeats(tmp_path: Path) -> None:
    rows = [unit_row("saltelli", "owen_blocks", 4, row, 3) for row in range(64)]
    x = np.concatenate(rows)
    table = np.column_stack([x[:, :2], ishigami(x)])
    found = analyse(written(tmp_path / "hidden.csv", table, "a,b,y"), ["y"])
    assert found["design"] is None and found["points"] == 128
    assert "of which the table lacks a factor" in " ".join(found["remarks"])
