"""What both estimators promise: independent formulas' values, any order, honest use of failures."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from SALib.analyze import sobol as salib_sobol
from scipy.stats import sobol_indices

from analysis.designs import METHODS, unit_row
from analysis.sensitivity.estimators import (
    Estimator,
    MorrisEstimator,
    SaltelliEstimator,
    Sample,
    SinglePoints,
    estimator_class,
)
from analysis.sensitivity.estimators.weightings import FIRST
from tests.testbed.estimators import CLASSES, FACTORS, OUTPUTS, SEED, empty, fed, values_of


def fingerprint(estimator: Estimator) -> bytes:
    """Return every bit that a snapshot is made of."""
    parts = [estimator.effects, *vars(estimator.moments()).values(), np.array(estimator.rows_used)]
    compared = [index for found in estimator.compared(0.9).values() for index in found.values()]
    for index in (*estimator.indices().values(), *compared):
        parts += [index.value, index.low, index.high]
    for statistic in estimator.statistics().values():
        parts += [] if statistic.tail is None else [statistic.tail.rows]
    return b"".join(part.tobytes() for part in parts)


def test_elementary_effects_are_equations_22_to_24() -> None:
    values = values_of(MorrisEstimator, 20)
    effects = np.empty((20, OUTPUTS, FACTORS))
    for row, factor in product(range(20), range(FACTORS)):
        points = unit_row("morris", "sobol", SEED, row, FACTORS)
        step = points[1 + factor, factor] - points[0, factor]
        effects[row, :, factor] = (values[row, 1 + factor] - values[row, 0]) / step
    found = fed(MorrisEstimator, values).indices()
    np.testing.assert_allclose(found["mu"].value, effects.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found["mu_star"].value, np.abs(effects).mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found["sigma"].value, effects.std(axis=0, ddof=1), 1e-10, 1e-12)


def test_a_linear_function_has_effects_without_spread() -> None:
    """The slopes come back whatever the steps, and sigma is 0, not their rounding."""
    points = np.stack([unit_row("morris", "sobol", SEED, row, FACTORS) for row in range(30)])
    slopes = np.array([2.0, -5.0, 0.0])
    estimator = fed(MorrisEstimator, np.repeat((points @ slopes)[..., None], OUTPUTS, axis=2))
    found = estimator.indices()
    np.testing.assert_allclose(found["mu"].value[0], slopes, atol=1e-13)
    np.testing.assert_allclose(found["mu_star"].value[0], np.abs(slopes), atol=1e-13)
    for ends in (found["sigma"].low, found["sigma"].value, found["sigma"].high):
        assert np.all(ends == 0.0)
    # What is more than rounding stays, however little it is.
    bent = (points @ slopes + 1e-12 * points[..., 0] ** 2)[..., None]
    estimator = fed(MorrisEstimator, np.repeat(bent, OUTPUTS, axis=2))
    sigma = estimator.indices()["sigma"].value[0]
    assert sigma[0] > 1e-13 and sigma[2] == 0.0


def test_first_and_total_order_are_scipys() -> None:
    rows = 128
    values = values_of(SaltelliEstimator, rows)
    found = fed(SaltelliEstimator, values).indices()
    oracle = sobol_indices(
        func={
            "f_A": np.moveaxis(values[:, 0], -1, 0),
            "f_B": np.moveaxis(values[:, 1], -1, 0),
            "f_AB": np.moveaxis(values[:, 2:], (1, 2), (0, 1)),
        },
        n=rows,
    )
    np.testing.assert_allclose(found["first_order"].value, oracle.first_order, rtol=1e-10)
    np.testing.assert_allclose(found["total_order"].value, oracle.total_order, rtol=1e-10)


def test_first_and_total_order_are_salibs() -> None:
    values = values_of(SaltelliEstimator, 64)
    found = fed(SaltelliEstimator, values).indices()
    problem = {"num_vars": FACTORS, "names": list("abc"), "bounds": [[0.0, 1.0]] * FACTORS}
    for output in range(OUTPUTS):
        # SALib's order within a row: A, A with a column of B for every factor, B.
        in_order = values[:, [0, *range(2, 2 + FACTORS), 1], output]
        oracle = salib_sobol.analyze(
            problem, in_order.ravel(), calc_second_order=False, num_resamples=2, seed=1
        )
        # SALib centres on the mean of all points; Saltelli et al. 2010 on that of A and B.
        np.testing.assert_allclose(found["first_order"].value[output], oracle["S1"], atol=1e-3)
        np.testing.assert_allclose(found["total_order"].value[output], oracle["ST"], rtol=1e-10)


@cache
def half_failed(cls: type[Estimator]) -> tuple[NDArray[np.float64], bytes]:
    """Return values of which some failed, and the bits of an estimator fed with all at once."""
    values = values_of(cls, 12)
    values[3, min(1, values.shape[1] - 1)] = values[5, 0, 0] = np.nan
    return values, fingerprint(fed(cls, values))


@pytest.mark.parametrize("cls", [*CLASSES, SinglePoints])
@settings(max_examples=15, deadline=None)
@given(order=st.permutations(range(12)), cuts=st.sets(st.integers(1, 11)), data=st.data())
def test_any_order_any_batches_and_any_merges_leave_the_same_bits(
    cls: type[Estimator], order: list[int], cuts: set[int], data: st.DataObject
) -> None:
    values, expected = half_failed(cls)
    batches = np.split(np.array(order), sorted(cuts))
    parts = []
    for batch in batches:
        part = empty(cls)
        part.add_rows(batch.tolist(), values[batch])
        if data.draw(st.booleans(), label="restart"):
            restarted = empty(cls)
            restarted.load_bytes(part.to_bytes())
            part = restarted
        parts.append(part)
    while len(parts) > 1:
        one = parts.pop(data.draw(st.integers(0, len(parts) - 1), label="merge"))
        parts[data.draw(st.integers(0, len(parts) - 1), label="into")].merge(one)
    assert fingerprint(parts[0]) == expected


def test_a_failed_base_costs_the_row_and_a_failed_move_one_effect() -> None:
    values = values_of(MorrisEstimator, 10)
    values[4, 0] = np.nan
    values[7, 2] = np.nan
    broken = fed(MorrisEstimator, values)
    assert broken.effects.tolist() == [[9, 8, 9]] * OUTPUTS
    assert broken.rows_used == 9
    kept = [row for row in range(10) if row not in (4, 7)]
    without = empty(MorrisEstimator)
    without.add_rows(kept, values[kept])
    for name in ("mu", "mu_star", "sigma"):
        expected = without.indices()[name].value[:, 1]
        assert np.array_equal(broken.indices()[name].value[:, 1], expected)
    assert broken.moments().n.tolist() == [38, 38]


def test_saltellis_indices_use_every_pair_that_succeeded() -> None:
    values = values_of(SaltelliEstimator, 32)
    values[2, 1] = np.nan  # B: no first order from this row, but total order
    values[9, 2 + 1] = np.nan  # A_B of the second factor
    values[20, 0] = np.nan  # A: nothing but B's value
    broken = fed(SaltelliEstimator, values)
    assert broken.effects.tolist() == [[30, 29, 30]] * OUTPUTS
    assert broken.rows_used == 31
    assert broken.moments().n.tolist() == [62, 62]
    every = np.concatenate([values[:, 0], values[:, 1]])
    mean, variance = np.nanmean(every, axis=0), np.nanvar(every, axis=0)
    for factor in range(FACTORS):
        difference = values[:, 2 + factor] - values[:, 0]
        first = np.nanmean((values[:, 1] - mean) * difference, axis=0) / variance
        total = 0.5 * np.nanmean(difference**2, axis=0) / variance
        found = broken.indices()
        np.testing.assert_allclose(found["first_order"].value[:, factor], first, rtol=1e-8)
        np.testing.assert_allclose(found["total_order"].value[:, factor], total, rtol=1e-8)


@pytest.mark.parametrize("cls", CLASSES)
def test_a_failure_of_one_output_leaves_the_others_alone(cls: type[Estimator]) -> None:
    values = values_of(cls, 16)
    whole = fed(cls, values).indices()
    values[5, 0, 0] = np.nan
    broken = fed(cls, values).indices()
    for name, index in whole.items():
        assert np.array_equal(broken[name].value[1], index.value[1])
        assert not np.array_equal(broken[name].value[0], index.value[0])


@pytest.mark.parametrize("cls", CLASSES)
def test_an_absurdly_large_output_counts_as_failed(cls: type[Estimator]) -> None:
    values = values_of(cls, 8)
    values[3, 1] = np.nan
    expected = fingerprint(fed(cls, values))
    for value in (np.inf, -np.inf, 1e101, -1e300):
        values[3, 1] = value
        assert fingerprint(fed(cls, values)) == expected, value


def test_an_output_that_never_varies_has_no_variance_to_share() -> None:
    """0.1 has no exact square, yet its variance is 0 and not rounding noise."""
    found = fed(SaltelliEstimator, np.full((50, FACTORS + 2, OUTPUTS), 0.1))
    assert np.all(found.moments().sd == 0.0)
    assert all(np.all(np.isnan(index.value)) for index in found.indices().values())


def test_a_small_spread_about_a_large_mean_keeps_its_digits() -> None:
    values = values_of(SaltelliEstimator, 64)
    near = fed(SaltelliEstimator, values).indices()["total_order"].value
    far = fed(SaltelliEstimator, values + 2.0**30).indices()["total_order"].value
    np.testing.assert_allclose(far, near, rtol=1e-5)


@pytest.mark.parametrize("cls", CLASSES)
def test_moments_are_those_of_the_design_s_random_points(cls: type[Estimator]) -> None:
    values = values_of(cls, 16)
    moments = fed(cls, values).moments()
    draws = values if cls is MorrisEstimator else values[:, :2]
    draws = draws.reshape(-1, OUTPUTS)
    np.testing.assert_allclose(moments.mean, draws.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(moments.sd, draws.std(axis=0, ddof=1), rtol=1e-10)
    assert moments.n.tolist() == [len(draws)] * OUTPUTS


@pytest.mark.parametrize("cls", CLASSES)
def test_without_rows_every_index_is_undefined(cls: type[Estimator]) -> None:
    estimator = empty(cls)
    for index in estimator.indices().values():
        assert np.all(np.isnan([index.value, index.low, index.high]))
    assert np.all(np.isnan(estimator.moments().mean))


@pytest.mark.parametrize("cls", CLASSES)
def test_estimators_of_different_studies_do_not_merge(cls: type[Estimator]) -> None:
    with pytest.raises(ValueError, match="only estimators of one study"):
        empty(cls).merge(empty(cls, seed=SEED + 1))
    with pytest.raises(ValueError, match="state of a study of other shape"):
        empty(cls).load_bytes(empty(cls, factors=2).to_bytes())


@pytest.mark.parametrize("cls", CLASSES)
def test_values_of_another_shape_are_refused(cls: type[Estimator]) -> None:
    with pytest.raises(ValueError, match=r"values must have shape \(1, "):
        empty(cls).add_rows([0], np.zeros((1, 2, OUTPUTS)))


@pytest.mark.parametrize("cls", CLASSES)
def test_fewer_weightings_leave_the_same_values_and_the_intervals_that_blocks_alone_tell(
    cls: type[Estimator],
) -> None:
    values = values_of(cls, 24)
    whole = fed(cls, values)
    for weightings in (1, FIRST):
        fewer = cls(
            sampling="sobol", seed=SEED, factors=FACTORS, outputs=OUTPUTS, weightings=weightings
        )
        fewer.add_rows(range(24), values)
        for name, index in fewer.indices().items():
            expected = whole.indices()[name]
            assert np.array_equal(index.value, expected.value)
            apart = whole.statistics()[name].apart
            unknown = weightings == 1 or (apart is not None and np.any(apart > 0.0))
            for end in ("low", "high"):
                found, wanted = getattr(index, end), getattr(expected, end)
                assert np.all(np.isnan(found) | (found == wanted))
                assert unknown or np.array_equal(found, wanted, equal_nan=True)
                assert not unknown or np.isnan(found).any()
        with pytest.raises(ValueError, match="cannot merge sums of shape"):
            fewer.merge(whole)


def test_every_method_has_its_estimator() -> None:
    assert [estimator_class(method) for method in METHODS] == [*CLASSES, SinglePoints, Sample]
    with pytest.raises(ValueError, match="unknown method 'fast'"):
        estimator_class("fast")
