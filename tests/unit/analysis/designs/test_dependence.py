"""Factors that depend on each other: what is possible, and that they do as they were asked."""

import json
import re
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri
from scipy.stats import kstest, spearmanr

from analysis.designs import DEPENDENT, SAMPLINGS, instance_parameters, orders_of, unit_row
from analysis.designs.dependence import (
    LEAST_EIGENVALUE,
    Dependence,
    DependenceError,
    conditional,
    copula,
)
from analysis.designs.distributions import (
    Discrete,
    Distribution,
    LogUniform,
    Normal,
    Triangular,
    Uniform,
)
from analysis.designs.points import latin_hypercube
from analysis.designs.shapley import shapley_orders
from sim.parameters.anthropometric import STUDY

NAMES = ("a", "b", "c")
SHAPES: tuple[Distribution, ...] = (
    Uniform(low=0.0, high=2.0),
    LogUniform(low=1.0, high=1000.0),
    Triangular(low=0.0, mode=1.0, high=5.0),
)


def of(*pairs: tuple[str, str, float], kind: str = "rank", shapes: Any = SHAPES) -> Any:
    names = tuple("abcdefgh"[: len(shapes)])
    return copula(Dependence(pairs=pairs, kind=kind), names, tuple(shapes))


def points(
    correlation: Any, rows: int = 600, sampling: str = "owen_blocks", method: str = "shapley"
) -> Any:
    """Return the A of many rows."""
    return np.stack([unit_row(method, sampling, 3, r, 3, correlation)[0] for r in range(rows)])


@pytest.mark.parametrize("method", DEPENDENT)
def test_factors_keep_their_distributions_and_get_their_rank_correlations(method: str) -> None:
    drawn = points(of(("a", "b", 0.6), ("b", "c", -0.4)))
    for column in drawn.T:
        assert kstest(column, "uniform").pvalue > 0.01
    found = spearmanr(drawn).statistic
    assert found[0, 1] == pytest.approx(0.6, abs=0.08)
    assert found[1, 2] == pytest.approx(-0.4, abs=0.08)
    assert found[0, 2] == pytest.approx(0.0, abs=0.08)


def test_linear_correlations_are_those_of_the_values() -> None:
    correlation = of(("a", "b", 0.5), kind="linear")
    values = [
        shape.ppf(column) for shape, column in zip(SHAPES, points(correlation).T, strict=True)
    ]
    assert np.corrcoef(values)[0, 1] == pytest.approx(0.5, abs=0.04)
    # Of a coin and a uniform factor it is at most the root of 3/4.
    coin = Discrete(values=(0.0, 1.0), probabilities=(0.5, 0.5))
    with pytest.raises(DependenceError, match=r"allow -0.86\d to 0.86\d"):
        of(("a", "b", 0.9), kind="linear", shapes=(coin, SHAPES[0]))
    # Of normal factors that is the copula's own.
    normals = (Normal(mean=5.0, sd=2.0), Normal(mean=0.0, sd=0.1))
    assert of(("a", "b", 0.3), kind="linear", shapes=normals)[0, 1] == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_every_point_of_a_row_is_a_draw_of_the_factors_together(sampling: str) -> None:
    correlation = of(("a", "b", 0.7))
    rows = np.stack([unit_row("shapley", sampling, 8, r, 3, correlation) for r in range(400)])
    for position in range(6):
        found = spearmanr(rows[:, position]).statistic
        assert found[0, 1] == pytest.approx(0.7, abs=0.09)
        assert kstest(rows[:, position, 2], "uniform").pvalue > 1e-3


@settings(max_examples=30, deadline=None)
@given(row=st.integers(0, 10**6), seed=st.integers(0, 2**63), k=st.integers(2, 6), data=st.data())
def test_points_share_the_first_factors_of_the_order_bit_for_bit(
    row: int, seed: int, k: int, data: st.DataObject
) -> None:
    value = data.draw(st.floats(-0.2, 0.9))
    correlation = np.full((k, k), value * (0.99 if value > 0 else 0.9))
    np.fill_diagonal(correlation, 1.0)
    order = orders_of("owen_blocks", seed, [row], k)[0].tolist()
    assert sorted(order) == list(range(k))
    found = unit_row("shapley", "owen_blocks", seed, row, k, correlation)
    assert found.shape == (k + 3, k)
    assert ((found > 0.0) & (found < 1.0)).all()
    for j in range(1, k):
        assert np.array_equal(found[1 + j, order[:j]], found[0, order[:j]])
        assert (found[1 + j, order[j:]] != found[0, order[j:]]).all()
    again = unit_row("shapley", "owen_blocks", seed, row, k, correlation)
    assert np.array_equal(found, again)


def test_an_order_is_the_same_in_whatever_company_it_is_asked_for() -> None:
    rows = [2047, 5, 1024, 1023, 5]
    together = orders_of("latin_hypercube", 3, rows, 5)
    for row, order in zip(rows, together, strict=True):
        assert np.array_equal(orders_of("latin_hypercube", 3, [row], 5)[0], order)
        point = latin_hypercube(3, row, 12)[None]
        assert np.array_equal(shapley_orders(3, [row], point[:, 10:], 5)[0], order)


def test_each_factor_is_first_and_last_equally_often() -> None:
    orders = orders_of("owen_blocks", 1, range(384), 4)
    for place in (0, -1):
        counts = np.bincount(orders[:, place], minlength=4)
        assert np.all(np.abs(counts - 96) <= 8), counts


def test_what_makes_correlated_normals_is_the_cholesky_factor() -> None:
    correlation = np.asarray(of(("a", "b", 0.6), ("b", "c", -0.4)))
    for order in ([0, 1, 2], [2, 0, 1]):
        expected = np.linalg.cholesky(correlation[np.ix_(order, order)])
        assert conditional(correlation, order) == pytest.approx(expected, abs=1e-14)


def test_without_correlations_points_are_those_of_independent_factors() -> None:
    shapes = dict(zip(NAMES, SHAPES, strict=True))
    alone = instance_parameters("shapley", "owen_blocks", 1, 7, shapes)
    apart = instance_parameters("shapley", "owen_blocks", 1, 7, shapes, np.eye(3))
    for one, other in zip(alone, apart, strict=True):
        assert one == pytest.approx(other, rel=1e-9)


def test_other_methods_know_independent_factors_only() -> None:
    with pytest.raises(ValueError, match="saltelli samples factors independently"):
        unit_row("saltelli", "sobol", 1, 0, 3, np.eye(3))


@pytest.mark.parametrize(
    ("pairs", "kind", "sentence"),
    [
        ([("a", "x", 0.5)], "rank", "x is not sampled"),
        ([("a", "b", 0.5), ("b", "a", 0.5)], "rank", "b and a are a pair twice"),
        ([("a", "a", 0.5)], "rank", "no correlation with itself"),
        ([("a", "b", 1.0)], "rank", "lies between -1 and 1"),
        ([("a", "b", float("nan"))], "rank", "lies between -1 and 1"),
        ([("a", "b", 0.5)], "kendall", "correlations are of rank or linear"),
        ([("a", "b", -0.95)], "linear", "their distributions allow -0.7"),
    ],
)
def test_what_no_factors_can_have_is_one_sentence(pairs: Any, kind: str, sentence: str) -> None:
    with pytest.raises(DependenceError) as caught:
        of(*pairs, kind=kind)
    assert sentence in str(caught.value)


@pytest.mark.parametrize("kind", ["rank", "linear"])
def test_of_a_contradiction_the_nearest_possible_is_named_and_is_possible(kind: str) -> None:
    with pytest.raises(DependenceError, match="contradict each other") as caught:
        of(("a", "b", 0.75), ("b", "c", 0.75), ("a", "c", -0.5), kind=kind)
    named = json.loads(str(caught.value).partition("are ")[2])
    of(*map(tuple, named), kind=kind)
    assert {frozenset(pair[:2]) for pair in named} == set(map(frozenset, combinations("abc", 2)))
    assert named[0][2] > 0.4 and named[1][2] < 0.0 and named[2][2] > 0.4


def test_bodies_are_as_the_preset_says() -> None:
    shapes = {f["name"]: Distribution.from_json(f["distribution"]) for f in STUDY["factors"]}
    pairs = tuple((a, b, r) for a, b, r in STUDY["correlations"])
    matrix = copula(Dependence(pairs=pairs), tuple(shapes), tuple(shapes.values()))
    drawn = np.stack([unit_row("shapley", "sobol", 3, r, 6, matrix)[0] for r in range(256)])
    names = list(shapes)
    found = spearmanr(drawn).statistic
    for a, b, r in pairs:
        assert found[names.index(a), names.index(b)] == pytest.approx(r, abs=0.08)


@settings(max_examples=40, deadline=None)
@given(k=st.integers(3, 8), seed=st.integers(0, 10**6))
def test_the_nearest_of_any_contradiction_is_possible(k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = (Uniform(low=0.0, high=1.0),) * k
    letters = "abcdefgh"[:k]
    pairs = [(a, b, float(rng.uniform(-0.999, 0.999))) for a, b in combinations(letters, 2)]
    try:
        found = of(*pairs, shapes=shapes)
    except DependenceError as error:
        named = json.loads(re.sub(".* are ", "", str(error)))
        found = of(*map(tuple, named), shapes=shapes)
    assert np.linalg.eigvalsh(found)[0] >= LEAST_EIGENVALUE * (1.0 - 1e-9)
    assert np.isfinite(ndtri(unit_row("shapley", "sobol", 1, 0, k, found))).all()
