"""Factors that depend on each other are named, whatever the form; independent ones are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.given.answer import analyse
from analysis.given.measures.hsic import hsic, hsic_of_pairs
from analysis.given.rows.dependence import dependence
from tests.testbed.given import written


def related(factors: Any, x: Any, *, drawn: bool = True) -> list[str]:
    return dependence(factors, x, drawn=drawn).remarks


def square(rng: Any, rows: int) -> Any:
    x = rng.uniform(-1.0, 1.0, (rows, 3))
    x[:, 1] = x[:, 0] ** 2 + rng.normal(0.0, 0.1, rows)
    return x


def circle(rng: Any, rows: int) -> Any:
    x, angle = rng.normal(size=(rows, 3)), rng.uniform(0.0, 2.0 * np.pi, rows)
    x[:, 0], x[:, 1] = np.cos(angle), np.sin(angle)
    return np.exp(3.0 * x)


@pytest.mark.parametrize("form", [square, circle])
def test_a_dependence_that_neither_rises_nor_falls_is_named(form: Any) -> None:
    for seed in range(3):
        (said,) = related("abc", form(np.random.default_rng(seed), 128))
        assert "(neither rising nor falling, by R²-HSIC: a and b (0." in said
        assert "c (" not in said and "pairs more" not in said


@pytest.mark.parametrize("settings", [2, 3, 5])
def test_factors_of_few_settings_in_all_are_answered(settings: int, tmp_path: Path) -> None:
    """Of a category that is told by one factor each there are as many different points."""
    rng = np.random.default_rng(3)
    x = np.eye(settings)[rng.integers(0, settings, 200)]
    y = x @ np.arange(settings) + 0.3 * rng.normal(size=200)
    table, names = np.column_stack([x, y]), ",".join("abcde"[:settings]) + ",y"
    found = analyse(written(tmp_path / "runs.csv", table, names), ["y"])
    shares = [one["value"] for one in found["outputs"]["y"]["measures"]["hdmr"].values()]
    assert all(share is not None and -0.1 < share < 1.1 for share in shares)


def test_what_is_named_by_ranks_is_not_named_again() -> None:
    x = np.random.default_rng(1).random((100, 3))
    x[:, 2] = x[:, 0] ** 3
    said, one = related("abc", x)
    assert "(rank correlation: a and c (+1.00))" in said
    assert one.startswith("As good as one quantity: a and c. ")


def test_independent_factors_are_hardly_ever_named() -> None:
    tables = (np.random.default_rng(table).random((64, 20)) for table in range(50))
    assert sum(bool(related([*"abcdefghijklmnopqrst"], np.exp(5.0 * x))) for x in tables) <= 1


def test_of_rows_that_are_not_drawn_only_ranks_are_looked_at() -> None:
    x = np.repeat(np.random.default_rng(0).random((20, 3)), 10, axis=0)
    assert "HSIC" not in " ".join(related("abc", x, drawn=False))


def test_hsic_of_all_pairs_is_that_of_each() -> None:
    x = square(np.random.default_rng(2), 90)
    share, p_value = hsic_of_pairs(x)
    for f in range(3):
        others = [g for g in range(3) if g != f]
        one = hsic(x[:, others], x[:, f])
        assert share[f, others] == pytest.approx(one.r2, rel=1e-9, abs=1e-12)
        assert p_value[f, others] == pytest.approx(one.p_value, rel=1e-6)


def test_an_answer_names_it(tmp_path: Path) -> None:
    x = circle(np.random.default_rng(3), 100)
    found = analyse(written(tmp_path / "s.csv", np.column_stack([x, x.sum(axis=1)])), ["y"])
    assert "by R²-HSIC: a and b" in " ".join(found["remarks"])


def test_runs_at_the_same_point_are_no_evidence_of_a_dependence(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    x = np.repeat(rng.random((30, 4)), 4, axis=0)
    assert related("abcd", x) != []
    table = np.column_stack([x, x.sum(axis=1) + rng.normal(size=120)])
    found = analyse(written(tmp_path / "repeats.csv", table, "a,b,c,d,y"), ["y"])
    assert "depend" not in " ".join(found["remarks"])


def test_rare_values_that_meet_once_or_twice_are_no_dependence() -> None:
    tables = [(np.random.default_rng(t).random((200, 6)) < 0.03).astype(float) for t in range(50)]
    assert sum(bool(related("abcdef", x)) for x in tables) <= 1
    both = tables[0].copy()
    both[:, 1] = both[:, 0]
    assert "a and b (+1.00)" in related("abcdef", both)[0]


def test_a_weak_correlation_of_many_rows_is_the_cause_that_is_named(tmp_path: Path) -> None:
    """Of 0.15 shares of a + b were 0.59 and 0.58, and waves or shifted outputs were said."""
    for seed in range(4):
        normal = np.random.default_rng(seed).normal(size=(1000, 3))
        normal[:, 1] = 0.15 * normal[:, 0] + np.sqrt(1.0 - 0.15**2) * normal[:, 1]
        table = np.column_stack([normal, normal[:, 0] + normal[:, 1]])
        remarks = " ".join(analyse(written(tmp_path / "x.csv", table), ["y"])["remarks"])
        assert "Factors depend on each other (rank correlation: a and b (+0." in remarks
        assert "waves" not in remarks and "stand beside" not in remarks
