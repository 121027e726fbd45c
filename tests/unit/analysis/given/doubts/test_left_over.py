"""What factors do only together is said, and so is that most of an output is not told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.given.answer import analyse
from analysis.given.doubts.left_over import alike, by_themselves, unexplained
from tests.testbed.given import ishigami, written


def told(*shares: float) -> Any:
    index = {
        name: {"value": share, "low": share - 0.02, "high": share + 0.02}
        for name, share in zip("abcd", shares, strict=False)
    }
    return {"rbd_fast": index}


def xor(x: Any) -> Any:
    return ((x[:, 0] > 0.5) ^ (x[:, 1] > 0.5)).astype(float)


@pytest.mark.parametrize(
    ("output", "named"),
    [
        (lambda x: (x[:, 0] + x[:, 1]) % 1.0 + 0.2 * x[:, 2], "a and b (by 0."),
        (xor, "a and b (by 0."),
        (lambda x: np.prod(x[:, :3] > 0.5, axis=1) + 2.0 * xor(x[:, 1:]), "b and c (by 0."),
        (lambda x: np.prod(np.sign(x[:, :3] - 0.5), axis=1), "some of all factors (by 0."),
    ],
)
def test_factors_that_only_act_together_are_said_to(output: Any, named: str) -> None:
    """All measures took them for idle, without a remark."""
    for seed in range(5):
        x = np.random.default_rng(seed).random((500, 4))
        most, together = unexplained("y", output(x), "abcd", x, told(0.0, 0.0, 0.1, 0.0))
        assert most.startswith("By themselves the factors explain 10% of y")
        assert named in together


def test_of_repeated_points_the_output_tells_that_they_act_together() -> None:
    x = np.random.default_rng(3).integers(0, 2, (400, 4)).astype(float)
    y = xor(x) + 0.1 * np.random.default_rng(4).normal(size=400)
    assert "a and b (by 0.9" in unexplained("y", y, "abcd", x, told(0.0, 0.0, 0.0, 0.0))[1]


def test_of_noise_no_factors_act_together_but_it_is_said_that_most_is_untold() -> None:
    wrong = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = rng.random((200, 3))
        # Its spread goes with a factor, too.
        y = x[:, 0] + (0.2 + 2.0 * x[:, 1]) * rng.standard_t(4, 200)
        said = unexplained("y", y, "abc", x, told(0.05, 0.0, 0.0))
        assert said[0].startswith("By themselves the factors explain 5% of y")
        wrong += len(said) > 1
    assert wrong == 0


def test_of_an_output_that_is_mostly_told_nothing_is_said() -> None:
    x = np.random.default_rng(1).random((500, 3))
    assert unexplained("y", ishigami(x), "abc", x, told(0.31, 0.44, 0.0)) == []
    # Half of it is within the interval.
    assert unexplained("y", ishigami(x), "abc", x, told(0.2, 0.28, 0.0)) == []
    assert unexplained("y", ishigami(x), "abc", x, {"rbd_fast": {}}) == []


def test_waves_of_one_factor_are_not_taken_for_what_two_do_together() -> None:
    x = np.random.default_rng(1).random((800, 3))
    y = np.sin(40.0 * np.pi * x[:, 0]) + 0.5 * x[:, 1]
    assert len(unexplained("y", y, "abc", x, told(0.0, 0.04, 0.0))) == 1


def test_each_factors_own_function_is_taken_off() -> None:
    rng = np.random.default_rng(2)
    x = np.column_stack([rng.random(400), rng.integers(0, 4, 400)])
    y = np.sin(5.0 * x[:, 0]) + np.array([0.0, 3.0, 1.0, -2.0])[x[:, 1].astype(int)]
    assert np.std(y - y.mean() - by_themselves(x, y).sum(axis=1)) < 0.01 * np.std(y)
    assert not by_themselves(rng.random((20, 10)), y[:20]).any()


def test_pairs_count_once() -> None:
    left = np.array([1.0, 1.0, -2.0])
    twice = alike(left, np.array([0, 1]), np.array([1, 0]))
    assert (twice.product, twice.errors) == (1.0, 1.0)


def test_an_answer_says_what_measures_of_single_factors_cannot_see(tmp_path: Path) -> None:
    x = np.random.default_rng(1).random((300, 3))
    remarks = analyse(written(tmp_path / "x.csv", np.c_[x, xor(x)]), ["y"])["remarks"]
    assert sum(remark.startswith("By themselves the factors") for remark in remarks) == 1
    assert any("act together on y: a and b" in remark for remark in remarks)
    told = analyse(written(tmp_path / "x.csv", np.c_[x, x.sum(axis=1)]), ["y"])
    assert told["remarks"] == []
    assert "only together" in told["measures"]["hsic"]["assumes"]
