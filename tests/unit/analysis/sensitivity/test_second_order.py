"""What indices of pairs promise: Saltelli 2002's design, SALib's numbers, known functions."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray
from SALib.analyze.sobol import second_order

from analysis.designs import row_width, unit_row
from analysis.sensitivity.estimators import SaltelliEstimator, SecondOrderEstimator
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan

METHOD = "saltelli_second_order"
PAIRS = list(combinations(range(3), 2))


def values_of(rows: int, shift: float = 0.0) -> NDArray[np.float64]:
    """Return Ishigami's function at the first rows of the design, shape (rows, width, 1)."""
    points = [unit_row(METHOD, "sobol", 12, row, 3) for row in range(rows)]
    x = np.pi * (2.0 * np.stack(points) - 1.0)
    y = np.sin(x[..., 0]) * (1.0 + 0.1 * x[..., 2] ** 4) + 7.0 * np.sin(x[..., 1]) ** 2
    return y[..., None] + shift


def fed(values: NDArray[np.float64]) -> SecondOrderEstimator:
    estimator = SecondOrderEstimator(sampling="sobol", seed=12, factors=3, outputs=1)
    estimator.add_rows(range(len(values)), values)
    return estimator


def test_a_row_is_that_of_first_and_total_order_and_then_its_mirror_image() -> None:
    row = unit_row(METHOD, "sobol", 12, 5, 3)
    assert row.shape == (row_width(METHOD, 3), 3) == (8, 3)
    assert np.array_equal(row[:5], unit_row("saltelli", "sobol", 12, 5, 3))
    for factor in range(3):
        expected = row[1].copy()
        expected[factor] = row[0, factor]
        assert np.array_equal(row[5 + factor], expected)


def test_indices_of_pairs_are_the_mean_of_salibs_with_a_and_b_in_either_place() -> None:
    values = values_of(64)
    found = fed(values).indices()["second_order"].value[0]
    # Where they are centred does not matter to ours; the mean of both is the same for any centre.
    y = values[:, :, 0] - values[:, :2].mean()
    a, b, from_a, from_b = y[:, 0], y[:, 1], y[:, 2:5], y[:, 5:]
    for place, (i, j) in enumerate(PAIRS):
        one = second_order(a, from_a[:, i], from_a[:, j], from_b[:, i], b)
        other = second_order(b, from_b[:, i], from_b[:, j], from_a[:, i], a)
        assert found[place] == pytest.approx((one + other) / 2.0, rel=1e-10, abs=1e-12)


def test_indices_of_pairs_of_ishigamis_function_come_out_right() -> None:
    """Factors 1 and 3 interact, and no others do (Ishigami and Homma 1990)."""
    found = fed(values_of(4096)).indices()["second_order"]
    variance = 7.0**2 / 8 + 0.1 * np.pi**4 / 5 + 0.1**2 * np.pi**8 / 18 + 0.5
    interaction = 0.1**2 * np.pi**8 * (1 / 18 - 1 / 50)
    np.testing.assert_allclose(found.value[0], [0.0, interaction / variance, 0.0], atol=0.01)
    assert found.low[0, 1] <= interaction / variance <= found.high[0, 1]


def test_first_and_total_order_are_those_of_the_smaller_design() -> None:
    values = values_of(32)
    small = SaltelliEstimator(sampling="sobol", seed=12, factors=3, outputs=1)
    small.add_rows(range(32), values[:, :5])
    found = fed(values).indices()
    for name, index in small.indices().items():
        assert np.array_equal(found[name].value, index.value)
        assert np.array_equal(found[name].low, index.low)


def test_a_constant_in_the_output_changes_nothing() -> None:
    near, far = (fed(values_of(32, shift)).indices()["second_order"] for shift in (0.0, 2.0**20))
    np.testing.assert_allclose(far.value, near.value, atol=1e-8)


def test_a_pair_with_an_idle_factor_has_exactly_nothing_together() -> None:
    plan = study_plan(METHOD, rows=16)
    results = results_of(plan, lambda x: {"y": x["a"] * x["c"], "z": x["b"]})
    pairs = analyse(plan, results)["outputs"]["y"]["second_order"]
    assert [pair["factors"] for pair in pairs] == [["a", "b"], ["a", "c"], ["b", "c"]]
    for pair in (pairs[0], pairs[2]):
        assert (pair["low"], pair["value"], pair["high"], pair["n"]) == (0.0, 0.0, 0.0, 16)
    assert pairs[1]["low"] < pairs[1]["value"] < pairs[1]["high"]
    assert list(FACTORS) == ["a", "b", "c"]


def test_a_failed_run_costs_only_the_pairs_that_need_it() -> None:
    plan = study_plan(METHOD, rows=16)
    # B with its first factor from A, and A with its third from B.
    results = results_of(plan, failed=[(3, 5), (9, 4)])
    pairs = analyse(plan, results)["outputs"]["y"]["second_order"]
    assert [pair["n"] for pair in pairs] == [15, 14, 15]


def test_pairs_need_two_factors() -> None:
    with pytest.raises(ValueError, match="saltelli_second_order must vary at least two factors"):
        row_width(METHOD, 1)


def test_pairs_have_a_series_of_growing_parts() -> None:
    """As factors have one: of the first 8, 16, 32 rows, in whatever order results came."""
    plan = study_plan(METHOD, rows=40)
    results = results_of(plan)
    shot = analyse(plan, list(reversed(results)))["outputs"]["y"]
    series = shot["convergence"]
    assert series["rows"] == [8, 16, 32]
    pairs = [pair["factors"] for pair in series["second_order"]]
    assert pairs == [["a", "b"], ["a", "c"], ["b", "c"]]
    whole = analyse(replace(plan, rows=32), [r for r in results if r.row < 32])["outputs"]["y"]
    for pair, curve in zip(whole["second_order"], series["second_order"], strict=True):
        assert [curve[end][-1] for end in ("low", "value", "high")] == [
            pair[end] for end in ("low", "value", "high")
        ]
