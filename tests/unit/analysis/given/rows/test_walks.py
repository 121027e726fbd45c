"""Outputs one line off the points of a Morris design are found, and those in place are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.designs import unit_row
from analysis.given.answer import analyse
from analysis.given.rows.layout import recognise
from analysis.given.rows.walks import one_line_off
from tests.testbed.given import ishigami, written


def walks(rows: int, factors: int, seed: int = 0) -> Any:
    return np.concatenate(
        [unit_row("morris", "trajectories", seed, row, factors) for row in range(rows)]
    )


@pytest.mark.parametrize(("moved", "where"), [(1, "first"), (-1, "last")])
def test_outputs_one_line_off_the_points_of_trajectories_are_named(moved: int, where: str) -> None:
    """An idle factor had a mu* of 1.9, the largest, without a word."""
    for seed in range(3):
        x = walks(40, 6, seed)
        y = np.roll(3.0 * x[:, 0] + 2.0 * x[:, 1] * x[:, 2], moved)
        (said,) = one_line_off("y", recognise(x), x, y)
        assert f"the {where} step of its rows" in said


@pytest.mark.parametrize(
    "output",
    [
        ishigami,
        lambda x: 3.0 * x[:, 0],
        lambda x: np.exp(5.0 * x[:, 0]) + x[:, 1] * x[:, 2],
        lambda x: np.random.default_rng(2).normal(size=len(x)),
        lambda x: np.where(x[:, 0] > 0.8, np.nan, x[:, 1]),
        lambda x: np.ones(len(x)),
    ],
)
def test_outputs_in_their_place_are_not(output: Any) -> None:
    for seed in range(10):
        x = walks(30, 4, seed)
        assert one_line_off("y", recognise(x), x, output(x)) == []
    assert one_line_off("y", None, x, output(x)) == []


def test_an_answer_does_not_trust_outputs_that_stand_beside_their_points(tmp_path: Path) -> None:
    x = walks(40, 6)
    y = np.roll(3.0 * x[:, 0] + 2.0 * x[:, 1] * x[:, 2], 1)
    remarks = analyse(written(tmp_path / "x.csv", np.c_[x, y], "a,b,c,d,e,f,y"), ["y"])["remarks"]
    assert any(remark.startswith("Do not trust what the design tells of y") for remark in remarks)


def test_outputs_a_trajectory_off_are_said_to_have_little_to_do_with_their_points(
    tmp_path: Path,
) -> None:
    x = walks(100, 4)
    for moved, said in ((5, True), (0, False)):
        y = np.roll(3.0 * x[:, 0] + 2.0 * x[:, 1] * x[:, 2], moved)
        remarks = analyse(written(tmp_path / "x.csv", np.c_[x, y], "a,b,c,d,y"), ["y"])["remarks"]
        assert any("do not stand beside the points" in remark for remark in remarks) == said
