"""What a surrogate promises: right indices on smooth models, and a warning elsewhere."""

import sys
from collections.abc import Callable

import numpy as np
import pytest

from analysis.designs import DEPENDENT, METHODS, instance_parameters, row_width
from analysis.sensitivity.polynomial_chaos import fit_chaos
from analysis.sensitivity.surrogate import GOOD, MOST_RUNS, _apart, answer
from analysis.sensitivity.table import Table
from tests.testbed.studies import FACTORS, study_plan

Function = Callable[[dict[str, float]], float]


def smooth(x: dict[str, float]) -> float:
    """y = a + a b; b from 0 to 2 acts through a only, c does nothing."""
    return x["a"] + x["a"] * x["b"]


def table(method: str, rows: int, function: Function = smooth, jams: tuple[int, ...] = ()) -> Table:
    """Return the results of a study; runs of `jams` are far off."""
    plan = study_plan(method, rows)
    width = row_width(method, len(FACTORS))
    points = [
        point
        for row in range(rows)
        for point in instance_parameters(method, plan.sampling, plan.seed, row, FACTORS)
    ]
    y = np.array([function(point) for point in points])
    y[list(jams)] += 25.0
    return Table(
        plan=plan,
        rows=np.arange(rows).repeat(width),
        positions=np.tile(np.arange(width), rows),
        outcomes=("ok",) * len(points),
        points=np.array([list(point.values()) for point in points]),
        values=np.stack([y, np.ones_like(y)], axis=1),
    )


@pytest.mark.parametrize("method", [method for method in METHODS if method not in DEPENDENT])
def test_a_smooth_model_is_answered_from_a_hundred_runs(method: str) -> None:
    """V(a (1 + b)) = E[a^2] E[(1 + b)^2] = 13/9; E[1 + b] = 2; V(b) = 1/3."""
    found = answer(table(method, rows=100 if method == "surrogate" else 24), "y")
    assert found.fit.held_out > 0.99
    assert "worth reading" in found.sentence
    assert found.outliers == () and found.without_outliers is None
    expected = {"a": (12 / 13, 1.0), "b": (0.0, 1 / 13), "c": (0.0, 0.0)}
    for name, (first, total) in expected.items():
        assert found.fit.first_order[name] == pytest.approx(first, abs=0.01)
        assert found.fit.total_order[name] == pytest.approx(total, abs=0.01)
    chaos = found.chaos
    assert chaos is not None and chaos.held_out > 0.999
    for name, (first, total) in expected.items():
        assert chaos.first_order[name] == pytest.approx(first, abs=0.002)
        assert chaos.total_order[name] == pytest.approx(total, abs=0.002)
    assert (
        "A polynomial chaos explains 100.0%; its ST are within 0.001 of the process"
        in found.sentence
    )


def test_without_openturns_the_process_answers_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openturns", None)
    found = answer(table("saltelli", rows=24), "y")
    assert found.chaos is None and "chaos" not in found.sentence


def test_an_expansion_predicts_what_it_was_fitted_to() -> None:
    x = np.random.default_rng(1).random((60, 2))
    chaos = fit_chaos(x, 1e6 + 3.0 * x[:, 0] ** 2 * x[:, 1])
    new = np.random.default_rng(2).random((5, 2))
    np.testing.assert_allclose(
        chaos.predict(new) - 1e6, 3.0 * new[:, 0] ** 2 * new[:, 1], atol=1e-6
    )
    assert chaos.terms < 12


def test_two_jams_are_named_and_the_answer_with_them_is_not_recommended() -> None:
    found = answer(table("saltelli", rows=24, jams=(5, 61)), "y")
    assert found.fit.held_out < GOOD
    assert "do not use the surrogate's indices" in found.sentence
    assert [outlier.instance for outlier in found.outliers] == ["study:1:0", "study:12:1"]
    assert found.outliers[0].value - found.outliers[0].predicted == pytest.approx(25.0, abs=1.0)
    assert found.without_outliers is not None and found.without_outliers.held_out > 0.99
    assert found.without_outliers.total_order["b"] == pytest.approx(1 / 13, abs=0.01)
    assert "study:1:0, study:12:1: look at these runs" in found.sentence


def test_what_no_factor_explains_has_no_answer() -> None:
    noise = np.random.default_rng(4)
    found = answer(table("saltelli", rows=24, function=lambda _: noise.normal()), "y")
    assert found.fit.held_out < 0.2
    assert "do not use" in found.sentence
    assert found.chaos is not None and found.chaos.held_out < 0.2
    assert "too little for its indices to be used" in found.sentence


def test_failed_runs_are_left_out_and_runs_are_limited() -> None:
    many = table("saltelli", rows=24)
    many.values[3::5, 0] = np.nan
    assert answer(many, "y").fit.runs == np.isfinite(many.values[:, 0]).sum() < MOST_RUNS


def test_it_says_what_is_missing() -> None:
    with pytest.raises(ValueError, match="has no output 'q': it has y, z"):
        answer(table("morris", rows=2), "q")
    with pytest.raises(ValueError, match="needs 15 runs with y, and there are 8"):
        answer(table("morris", rows=2), "y")
    with pytest.raises(ValueError, match="indices are those of independent factors"):
        answer(table("shapley", rows=20), "y")
    with pytest.raises(ValueError, match="z is the same in all 20 runs"):
        answer(table("morris", rows=5), "z")


@pytest.mark.parametrize(
    "function",
    [
        lambda x: float(x["a"] > 0.3) + 0.2 * x["b"],
        lambda x: max(x["a"] + x["b"] - 2.0, 0.0) ** 0.5,
        lambda x: abs(x["a"]) + float(x["a"] > 0.6) * float(x["b"] > 1.2),
    ],
    ids=["a jump", "a kink", "a corner that jumps"],
)
def test_a_correct_run_at_a_jump_or_a_kink_is_no_outlier(function: Function) -> None:
    assert answer(table("saltelli", rows=24, function=function), "y").outliers == ()


def test_errors_lie_apart_if_they_are_few_and_far_from_all_others() -> None:
    usual = np.random.default_rng(1).standard_t(3, size=400)  # of every size
    assert not _apart(np.abs(usual)).any()
    gone_wrong = np.concatenate([0.1 * np.random.default_rng(1).random(398), [5.0, 9.0]])
    assert np.flatnonzero(_apart(gone_wrong)).tolist() == [398, 399]
    many = np.concatenate([0.1 * np.random.default_rng(1).random(380), np.full(20, 5.0)])
    assert not _apart(many).any()
