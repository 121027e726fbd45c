"""What a snapshot promises: JSON of a fixed shape, null where nothing is known, honest counts."""

import json
from dataclasses import replace
from math import cos, sin

import numpy as np
import pytest

from analysis.designs import METHODS, WITH_INDICES, instance_parameters
from analysis.designs.distributions import Normal, scales
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import FACTORS, results_of, study_plan, two_outputs

INTERVAL = {"value", "low", "high"}
SHARES = {"first_order", "total_order"}
INDICES = {
    "morris": {"mu", "mu_star", "sigma"},
    "saltelli": SHARES,
    "saltelli_second_order": SHARES,
    "surrogate": SHARES,
    "sample": SHARES,
    "shapley": {"shapley"}
    | {f"{kind}_{order}_order" for kind in ("full", "independent") for order in ("first", "total")},
}
SUMS_OF_SHARES = {"sum_first_order", "sum_total_order", "dummy_first_order"}
SUMS = {
    "morris": set(),
    "saltelli": SUMS_OF_SHARES,
    "saltelli_second_order": SUMS_OF_SHARES | {"second_order"},
    "shapley": set(),
    "surrogate": {"sum_first_order", "sum_total_order", "surrogate"},
    "sample": {"sum_first_order", "sum_total_order"},
}
MORE = {
    "morris": {"per_unit"},
    "shapley": set(),
    "surrogate": {"interaction"},
    "sample": {"interaction"},
}
OUTPUT = {"mean", "sd", "n", "factors", "ranking", "trust", "screening", "convergence"}


@pytest.mark.parametrize("method", METHODS)
def test_a_snapshot_has_the_same_shape_with_and_without_results(method: str) -> None:
    plan = study_plan(method, rows=8)
    for snapshot in (empty_snapshot(plan), analyse(plan, results_of(plan))):
        assert json.loads(json.dumps(snapshot, allow_nan=False)) == snapshot
        assert list(snapshot) == [
            *("study", "method", "seed", "cursor", "rows", "rows_complete", "rows_used"),
            *("level", "evaluations", "outputs", "sampling", "failure"),
        ]
        assert list(snapshot["outputs"]) == ["y", "z"]
        failure = dict(snapshot["failure"])
        assert failure.pop("sentence") == ""
        said = ("depends_on_factors", "caused_by", "goes_with", "detectable")
        for key in ("failed", "runs", *said):
            failure.pop(key)
        for output in (*snapshot["outputs"].values(), failure):
            assert set(output) == OUTPUT | SUMS[method]
            assert list(output["factors"]) == ["a", "b", "c"]
            for factor in output["factors"].values():
                more = MORE.get(method, {"rests_on", "martinez", "interaction"})
                assert set(factor) == INDICES[method] | {"n", "worst_case"} | more
                assert all(set(factor[index]) == INTERVAL for index in INDICES[method])


@pytest.mark.parametrize("method", METHODS)
def test_a_study_without_results_knows_nothing_and_says_null(method: str) -> None:
    snapshot = empty_snapshot(study_plan(method, rows=8))
    assert (snapshot["cursor"], snapshot["rows_complete"], snapshot["rows_used"]) == (0, 0, 0)
    assert snapshot["evaluations"] == {}
    output = snapshot["outputs"]["y"]
    assert (output["mean"], output["sd"], output["n"]) == (None, None, 0)
    for factor in output["factors"].values():
        assert factor["n"] == 0
        assert all(set(factor[index].values()) == {None} for index in INDICES[method])


@pytest.mark.parametrize("method", WITH_INDICES)
def test_every_interval_is_in_order_and_contains_its_estimate(method: str) -> None:
    # A function is fitted to 128 rows at first.
    plan = study_plan(method, rows=128 if method == "surrogate" else 64)
    for output in analyse(plan, results_of(plan))["outputs"].values():
        for factor in output["factors"].values():
            for index in INDICES[method]:
                assert factor[index]["low"] <= factor[index]["value"] <= factor[index]["high"]


def test_a_sample_has_mean_and_spread_and_says_null_for_its_indices() -> None:
    plan = study_plan("sample", rows=64)
    results = results_of(plan)
    found = analyse(plan, results)["outputs"]["y"]
    values = [result.outputs["y"] for result in results]
    assert found["mean"] == pytest.approx(np.mean(values), rel=1e-12)
    assert found["sd"] == pytest.approx(np.std(values, ddof=1), rel=1e-12)
    assert found["n"] == 64
    for factor in found["factors"].values():
        for index in (*SHARES, "interaction"):
            assert set(factor[index].values()) == {None}
        assert factor["worst_case"] is None
    assert (found["ranking"]["order"], found["screening"]["influential"]) == (None, [])


def test_counts_tell_results_complete_rows_and_rows_used_apart() -> None:
    plan = study_plan("morris", rows=6)
    results = results_of(plan, failed=[(1, 0), (3, 2)])
    snapshot = analyse(plan, [r for r in results if (r.row, r.position) != (5, 3)])
    assert snapshot["cursor"] == 23
    assert snapshot["evaluations"] == {"diverged": 2, "ok": 21}
    assert snapshot["rows"] == 6
    assert snapshot["rows_complete"] == 5
    assert snapshot["rows_used"] == 4
    assert [f["n"] for f in snapshot["outputs"]["y"]["factors"].values()] == [4, 3, 4]


def test_one_row_gives_estimates_but_no_spread() -> None:
    plan = study_plan("morris", rows=1)
    factor = analyse(plan, results_of(plan))["outputs"]["y"]["factors"]["a"]
    assert factor["mu"]["value"] is not None
    assert factor["sigma"] == {"value": None, "low": None, "high": None}


def test_indices_of_known_functions_come_out_right() -> None:
    """y = a + 2 a b + sin c has closed forms."""
    plan = study_plan("saltelli", rows=1024)
    output = analyse(plan, results_of(plan))["outputs"]["y"]
    # V(a) E(1 + 2b)^2 with V(a) = 1/3 and E(1 + 2b) = 3, and V(a) V(2b) with V(2b) = 4/3.
    v_a, v_ab = 3.0, 4.0 / 9.0
    mean = (cos(10.0) - cos(30.0)) / 20.0
    v_c = 0.5 - (sin(60.0) - sin(20.0)) / 80.0 - mean**2
    variance = v_a + v_ab + v_c
    expected = {"a": (v_a, v_a + v_ab), "b": (0.0, v_ab), "c": (v_c, v_c)}
    assert output["sd"] == pytest.approx(variance**0.5, rel=0.02)
    for name, (first, total) in expected.items():
        factor = output["factors"][name]
        assert factor["first_order"]["value"] == pytest.approx(first / variance, abs=0.02)
        assert factor["total_order"]["value"] == pytest.approx(total / variance, abs=0.02)
    assert output["sum_first_order"]["value"] == pytest.approx(1 - v_ab / variance, abs=0.02)


def test_effects_per_unit_are_those_of_equation_22_with_steps_in_the_factors_units() -> None:
    plan = study_plan("morris", rows=40)
    factors = analyse(plan, results_of(plan))["outputs"]["y"]["factors"]
    for place, name in enumerate(FACTORS):
        effects = []
        for row in range(plan.rows):
            points = instance_parameters("morris", plan.sampling, plan.seed, row, FACTORS)
            base, moved = points[0], points[1 + place]
            change = two_outputs(moved)["y"] - two_outputs(base)["y"]
            effects.append(change / (moved[name] - base[name]))
        per_unit = factors[name]["per_unit"]
        assert per_unit["mu"]["value"] == pytest.approx(np.mean(effects), rel=1e-9)
        assert per_unit["mu_star"]["value"] == pytest.approx(np.mean(np.abs(effects)), rel=1e-9)
        assert per_unit["sigma"]["value"] == pytest.approx(np.std(effects, ddof=1), rel=1e-9)
        for index in ("mu", "mu_star", "sigma"):
            for end in ("low", "value", "high"):
                per_range = per_unit[index][end] * FACTORS[name].scale.width
                assert per_range == pytest.approx(factors[name][index][end], rel=1e-12)


def test_effects_of_a_factor_that_is_not_uniform_are_scaled_by_its_quantiles() -> None:
    own = {**FACTORS, "b": Normal(mean=1.0, sd=0.3)}
    plan = replace(study_plan("morris", rows=8), scales=scales(own))
    factors = analyse(plan, results_of(plan, distributions=own))["outputs"]["y"]["factors"]
    per_unit, width = factors["b"]["per_unit"], 2.0 * 1.6448536 * 0.3 / 0.9
    assert per_unit["scale"] == {"width": pytest.approx(width), "by": "quantiles"}
    assert per_unit["mu"]["low"] == pytest.approx(factors["b"]["mu"]["low"] / width)
    assert factors["a"]["per_unit"]["scale"] == {"width": 2.0, "by": "range"}
    without = replace(plan, scales={})
    unknown = analyse(without, results_of(plan, distributions=own))["outputs"]["y"]["factors"]
    assert unknown["b"]["per_unit"] is None
    assert factors["a"]["per_unit"]["mu_star"]["value"] == factors["a"]["mu_star"]["value"] / 2.0
