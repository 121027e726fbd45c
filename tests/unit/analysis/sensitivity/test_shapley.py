"""Shapley effects, full and independent indices: closed forms, and what rows leave in the sums."""

from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri

from analysis.designs import unit_row
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.estimators import SaltelliEstimator, ShapleyEffects, ShapleyEstimator
from analysis.sensitivity.estimators.shares import LOW
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.functions.dependent import (
    Values,
    ishigami,
    ishigami_of_dependent,
    linear,
    truths,
)

CORRELATED = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.4], [0.0, -0.4, 1.0]])


@lru_cache(maxsize=8)
def estimated(function: Any, correlation: bytes | None, rows: int, k: int = 3) -> Any:
    matrix = None if correlation is None else np.frombuffer(correlation).reshape(k, k)
    points = np.stack(
        [unit_row("shapley", "owen_blocks", 13, row, k, matrix) for row in range(rows)]
    )
    estimator = ShapleyEstimator(sampling="owen_blocks", seed=13, factors=k, outputs=1)
    estimator.add_rows(range(rows), function(points)[..., None])
    return estimator.indices()


def weighted(u: Any) -> Any:
    return ndtri(u) @ np.array([1.0, 2.0, 3.0])


def added(u: Any) -> Any:
    return ndtri(u[..., 0]) + ndtri(u[..., 1])


@pytest.mark.parametrize(
    ("function", "correlation", "known"),
    [
        (weighted, CORRELATED, linear(np.array([1.0, 2.0, 3.0]), CORRELATED)),
        (weighted, np.eye(3), linear(np.array([1.0, 2.0, 3.0]), np.eye(3))),
        # The third does nothing, and tells of the second.
        (added, CORRELATED, linear(np.array([1.0, 1.0, 0.0]), CORRELATED)),
        (ishigami, np.array([[1, 0, 0.5], [0, 1, 0], [0.5, 0, 1]]), ishigami_of_dependent(0.5)),
        (ishigami, np.array([[1, 0, -0.8], [0, 1, 0], [-0.8, 0, 1]]), ishigami_of_dependent(-0.8)),
    ],
)
def test_indices_are_those_of_the_closed_form(
    function: Any, correlation: Any, known: Values
) -> None:
    found = estimated(function, np.asarray(correlation, dtype=float).tobytes(), 1024)
    for name, truth in truths(known).items():
        assert found[name].value[0] == pytest.approx(truth, abs=0.12 if "_" in name else 0.05), name
    assert found["shapley"].value.sum() == pytest.approx(1.0, abs=1e-12)


def test_effects_alone_are_the_same_to_the_last_bit() -> None:
    points = np.stack([unit_row("shapley", "owen_blocks", 13, row, 3) for row in range(24)])
    alone = ShapleyEffects(sampling="owen_blocks", seed=13, factors=3, outputs=1)
    alone.add_rows(range(24), ishigami(points)[..., None])
    (found,) = alone.indices().values()
    whole = estimated(ishigami, None, 24)["shapley"]
    for end in ("value", "low", "high"):
        assert np.array_equal(getattr(found, end), getattr(whole, end))


def test_total_indices_allow_for_a_tail_as_far_as_the_output_may_have_one() -> None:
    points = np.stack([unit_row("shapley", "owen_blocks", 13, row, 2) for row in range(64)])
    estimator = ShapleyEstimator(sampling="owen_blocks", seed=13, factors=2, outputs=2)
    even, heavy = np.sign(points[..., 0] - 0.5), points[..., 0] ** 12
    estimator.add_rows(range(64), np.stack([even, heavy], axis=-1))
    for name in ("full_total_order", "independent_total_order"):
        sides = estimator.statistics()[name].longer
        assert sides is not None and sides[0] == 1.0 and sides[1] == LOW


def test_of_independent_ishigami_effects_are_the_published_ones() -> None:
    # S and ST (Ishigami and Homma 1990); an interaction is shared equally (Owen 2014).
    first, total = np.array([0.3139, 0.4424, 0.0]), np.array([0.5576, 0.4424, 0.2437])
    found = estimated(ishigami, None, 1024)
    assert found["shapley"].value[0] == pytest.approx(0.5 * (first + total), abs=0.04)
    for name, truth in (("full", total), ("independent", total)):
        assert found[f"{name}_total_order"].value[0] == pytest.approx(truth, abs=0.12)
    for name in ("full", "independent"):
        assert found[f"{name}_first_order"].value[0] == pytest.approx(first, abs=0.12)


def test_of_a_linear_model_full_orders_agree_and_independent_ones_do() -> None:
    found = estimated(weighted, CORRELATED.tobytes(), 1024)
    for kind in ("full", "independent"):
        first, total = (found[f"{kind}_{order}_order"].value for order in ("first", "total"))
        assert first == pytest.approx(total, abs=0.12)


def test_a_factor_that_does_nothing_and_depends_on_none_has_exactly_nothing() -> None:
    found = estimated(lambda u: ndtri(u[..., 0]) * u[..., 2], np.eye(3).tobytes(), 64)
    for index in found.values():
        assert index.value[0, 1] == index.low[0, 1] == index.high[0, 1] == 0.0


@cache
def of_a_copula() -> tuple[StudyPlan, list[LoggedResult], dict[str, Any]]:
    """Return a study, its results in order, of which one failed, and its snapshot."""
    study = StudyPlan(
        id="s",
        method="shapley",
        seed=5,
        sampling="owen_blocks",
        rows=9,
        factors=("a", "b", "c"),
        outputs=("y",),
    )
    every = [
        LoggedResult(
            seq=len(row) * number + position + 1,
            instance=f"s:{number}:{position}",
            row=number,
            position=position,
            outcome="ok" if (number, position) != (4, 2) else "stuck",
            outputs={"y": float(weighted(point))} if (number, position) != (4, 2) else {},
        )
        for number in range(study.rows)
        for row in [unit_row("shapley", "owen_blocks", 5, number, 3, CORRELATED)]
        for position, point in enumerate(row)
    ]
    return study, every, analyse(study, every)


@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_of_a_copula_order_batches_and_restarts_leave_no_trace(data: st.DataObject) -> None:
    """Rows are sampled, and results arrive, in any order; the analysis stops and goes on."""
    study, every, expected = of_a_copula()
    order = data.draw(st.permutations(range(len(every))))
    cut = data.draw(st.integers(0, len(every)))
    drawn = [unit_row("shapley", "owen_blocks", 5, every[i].row, 3, CORRELATED) for i in order]
    for i, row in zip(order, drawn, strict=True):
        y = every[i].outputs.get("y")
        assert y is None or y == float(weighted(row[every[i].position]))
    shuffled = [replace(every[i], seq=seq + 1) for seq, i in enumerate(order)]
    state = EstimatorState(study)
    state.take(shuffled[:cut])
    state = EstimatorState.from_bytes(study, state.to_bytes())
    state.take(shuffled[cut:])
    assert state.snapshot() == expected


def test_symbols_and_kurtosis_are_those_of_shares() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=(40, 5, 1))
    ours = ShapleyEstimator(sampling="sobol", seed=1, factors=2, outputs=1)
    theirs = SaltelliEstimator(sampling="sobol", seed=1, factors=2, outputs=1)
    ours.add_rows(range(40), values)
    theirs.add_rows(range(40), values[:, :4])
    assert ours.kurtosis() == theirs.kurtosis()
    assert ours.independent_runs() == theirs.independent_runs() == 80


def test_a_failed_run_costs_the_factors_beside_it_only() -> None:
    values = np.random.default_rng(1).normal(size=(64, 6, 1))
    values[5, 3] = np.nan
    estimator = ShapleyEstimator(sampling="owen_blocks", seed=1, factors=3, outputs=1)
    estimator.add_rows(range(64), values)
    assert sorted(estimator.effects[0].tolist()) == [63, 63, 64]
