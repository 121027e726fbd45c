"""Indices that cannot be together raise an alarm, and those that can do not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.designs import unit_row
from analysis.given.answer import analyse
from analysis.given.doubts import contradictions
from tests.testbed.given import written

ALARMS = ("Do not trust the design's S", "Two answers")


def design(rows: int, seed: int = 4) -> Any:
    return np.concatenate(
        [unit_row("saltelli", "owen_blocks", seed, row, 3) for row in range(rows)]
    )


def interval(low: float, high: float) -> dict[str, float]:
    return {"value": (low + high) / 2.0, "low": low, "high": high}


def test_outputs_that_stand_one_row_below_their_points_raise_an_alarm(tmp_path: Path) -> None:
    """S summed to 1.68, at least to 1.14, without a remark."""
    x = design(256).reshape(256, 5, 3)[:, [0, 2, 3, 4, 1]].reshape(-1, 3)
    for moved, said in ((1, True), (0, False)):
        table = np.column_stack([x, np.roll(x @ [1.0, 0.7, 0.5], moved)])
        remarks = analyse(written(tmp_path / "rolled.csv", table), ["y"])["remarks"]
        for alarm in ALARMS:
            assert any(alarm in remark for remark in remarks) == said


@pytest.mark.parametrize(
    "function",
    [
        lambda x: x.sum(axis=1),
        lambda x: x[:, 0],
        lambda x: np.prod(np.abs(4.0 * x - 2.0) + np.arange(3.0), axis=1),
    ],
)
def test_honest_designs_raise_none(function: Any, tmp_path: Path) -> None:
    for seed in range(4):
        x = design(128, seed)
        table = np.column_stack([x, function(x)])
        remarks = " ".join(analyse(written(tmp_path / "d.csv", table), ["y"])["remarks"])
        assert not any(alarm in remarks for alarm in ALARMS)
        assert "Do not trust" not in remarks


def test_shares_may_sum_to_one_but_not_surely_to_more() -> None:
    one = {"a": interval(0.5, 0.6), "b": interval(0.5, 0.6), "c": interval(-0.3, 0.2)}
    assert contradictions.beyond_the_whole("y", {"hdmr": one}, 0.9) == []
    (said,) = contradictions.beyond_the_whole("y", {"hdmr": one | {"c": interval(0.1, 0.2)}}, 0.9)
    assert said.startswith("Do not trust hdmr of y") and "sum to 1.10" in said
    untold = {"a": {"value": None, "low": None, "high": None}}
    assert contradictions.beyond_the_whole("y", {"hdmr": untold}, 0.9) == []
    assert contradictions.two_answers("y", one, {"hdmr": untold}, 0.9) == []


def test_the_many_lower_ends_of_idle_factors_are_no_alarm() -> None:
    """Of 150 factors, of which two did all, lower ends summed to 1.04."""
    rng = np.random.default_rng(3)
    idle = {f"x{f}": interval(v - 0.04, v + 0.04) for f, v in enumerate(rng.normal(0, 0.025, 148))}
    told = {"a": interval(0.45, 0.55), "b": interval(0.45, 0.55), **idle}
    assert sum(max(one["low"], 0.0) for one in told.values()) > 1.0
    assert contradictions.beyond_the_whole("y", {"rbd_fast": told}, 0.9) == []


def test_two_measures_of_the_same_rows_that_surely_differ_are_named() -> None:
    told = {
        "rbd_fast": {"a": interval(0.75, 0.83), "b": interval(0.05, 0.15)},
        "hdmr": {"a": interval(0.59, 0.65), "b": interval(0.08, 0.12)},
    }
    (said,) = contradictions.apart("y", told, 0.9)
    assert said.startswith("Do not trust the share of a in y: it is 0.79 by rbd_fast and 0.62")
    near = told | {"hdmr": {"a": interval(0.71, 0.79), "b": interval(0.1, 0.14)}}
    untold = {"value": None, "low": None, "high": None}
    assert contradictions.apart("y", near, 0.9) == []
    assert contradictions.apart("y", told, 0.9, known={"a"}) == []
    assert contradictions.apart("y", told | {"hdmr": {"a": untold, "b": untold}}, 0.9) == []


def test_two_shares_of_factors_that_depend_on_each_other_are_said_and_why(tmp_path: Path) -> None:
    """Of the four a and b had 0.67 and 0.26 without a word; c and d have one share each."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=(500, 4))
        x[:, 1] = 0.7 * x[:, 0] + 0.7 * x[:, 1]
        table = np.column_stack([x, x @ [1.0, 1.0, 1.0, 0.5]])
        remarks = analyse(written(tmp_path / "r.csv", table, "a,b,c,d,y"), ["y"])["remarks"]
        (said,) = [one for one in remarks if one.startswith("Two shares of y each: a ")]
        assert ", b 0." in said and " c " not in said and "hdmr deals" in said
        assert "Do not trust" not in " ".join(remarks)


def test_a_contradiction_is_said_beside_factors_that_depend_on_each_other() -> None:
    told = {
        "rbd_fast": {f: interval(0.75, 0.83) for f in "abcdefgh"},
        "hdmr": {f: interval(0.59, 0.65) for f in "abcdefgh"},
    }
    alone, dealt = contradictions.apart("y", told, 0.9, tied=set("bcdefgh"))
    assert alone.startswith("Do not trust the share of a in y") and " f 0.79" in dealt
    assert dealt.count("0.62 by hdmr") == 5 and "hdmr and 2 more." in dealt


@pytest.mark.parametrize(("correlation", "said"), [(0.99, True), (0.0, False)])
def test_shares_of_factors_that_cancel_are_said_to_be_no_parts(
    correlation: float, said: bool, tmp_path: Path
) -> None:
    """Of 2 a - b they are 1.94 and -0.94, if a and b go together."""
    rng = np.random.default_rng(2)
    x = rng.multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], 400)
    table = np.column_stack([x, x @ [2.0, -1.0] + 0.1 * rng.normal(size=400)])
    remarks = analyse(written(tmp_path / "runs.csv", table, "a,b,y"), ["y"])["remarks"]
    about = [one for one in remarks if one.startswith("Shares of y by hdmr lie outside 0 to 1 (a ")]
    assert bool(about) == said


@pytest.mark.parametrize(("rows", "said"), [(100, True), (128, False)])
def test_of_few_rows_it_is_said_that_intervals_are_not_to_be_believed(
    rows: int, said: bool, tmp_path: Path
) -> None:
    table = np.random.default_rng(1).random((rows, 4))
    remarks = " ".join(analyse(written(tmp_path / "few.csv", table), ["y"])["remarks"])
    assert (f"such as these {rows}, are not to be believed" in remarks) == said
