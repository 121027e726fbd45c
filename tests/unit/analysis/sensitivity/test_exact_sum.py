"""What an exact sum promises: the true sum, rounded once, whatever the order of its terms."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.sensitivity.estimators.exact_sum import LIMB_BITS, ExactSums, divide, split, square

NUMBERS = st.lists(st.floats(-1e200, 1e200), min_size=1, max_size=30)


def total_of(sums: ExactSums) -> Fraction:
    """Return the exact sum of the first weighting and column."""
    numbers, shift = sums.integers(slice(0, 1)), sums.shift
    return Fraction(int(numbers[0, 0]), 2**shift)


def summed(values: list[float]) -> ExactSums:
    sums = ExactSums(1, 1)
    if values:
        terms = np.array(values)[None, :, None]
        sums.add(slice(0, 1), np.ones((1, len(values))), terms)
    return sums


@settings(deadline=None)
@given(NUMBERS)
def test_limbs_are_whole_numbers_that_make_up_the_value_exactly(values: list[float]) -> None:
    low, limbs = split(np.array(values))
    assert np.all(limbs == np.trunc(limbs))
    assert np.all(np.abs(limbs) < 2.0**LIMB_BITS)
    grid = [Fraction(2) ** (LIMB_BITS * (low + place)) for place in range(len(limbs))]
    for i, value in enumerate(values):
        parts = (int(limb[i]) * unit for limb, unit in zip(limbs, grid, strict=True))
        assert sum(parts) == Fraction(value)


@settings(deadline=None)
@given(NUMBERS)
def test_a_sum_is_the_true_sum_rounded_once(values: list[float]) -> None:
    sums = summed(values)
    numbers, shift = sums.integers(slice(0, 1)), sums.shift
    assert total_of(sums) == sum(map(Fraction, values))
    rounded = divide(numbers, np.ones_like(numbers), shift)
    assert rounded[0, 0] == math.fsum(values)


@settings(deadline=None)
@given(NUMBERS, st.randoms(use_true_random=False))
def test_any_order_and_any_tree_of_merges_give_the_same_sum(values: list[float], random) -> None:
    leaves = [summed([value]) for value in values]
    random.shuffle(leaves)
    while len(leaves) > 1:
        one = leaves.pop(random.randrange(len(leaves)))
        leaves[random.randrange(len(leaves))].merge(one)
    assert total_of(leaves[0]) == total_of(summed(values))


@pytest.mark.parametrize("value", [5e-324, -5e-324, 1.7e308, 2.0**-1022, 0.0, -0.0, 1e16 + 2])
def test_the_ends_of_the_number_range_are_summed_exactly(value: float) -> None:
    assert total_of(summed([value, 1.0, value])) == 2 * Fraction(value) + 1


def test_weights_count_a_row_as_often_as_they_say() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(1e3, 1.0, (2, 5, 3))
    weights = rng.integers(0, 14, (4, 5)).astype(float)
    sums = ExactSums(4, 7)
    sums.add(slice(2, 5), weights, values)
    numbers, shift = sums.integers(slice(0, 7)), sums.shift
    for weighting in range(4):
        for column in range(3):
            expected = sum(
                int(weights[weighting, row]) * Fraction(values[term, row, column])
                for term in range(2)
                for row in range(5)
            )
            assert Fraction(int(numbers[weighting, 2 + column]), 2**shift) == expected
    assert not np.any(numbers[:, [0, 1, 5, 6]]), "the other columns stay as they were"


def test_large_batches_are_as_exact_as_small_ones() -> None:
    """More terms than one matrix product may hold."""
    values = np.full((4, 40_000, 1), 1.0 + 2.0**-52)
    sums = ExactSums(1, 1)
    sums.add(slice(0, 1), np.full((1, 40_000), 15.0), values)
    assert total_of(sums) == 160_000 * 15 * Fraction(1.0 + 2.0**-52)


@pytest.mark.parametrize("weightings", [2, 40])
def test_many_columns_are_summed_in_parts_and_as_exactly(weightings: int) -> None:
    values = np.random.default_rng(5).normal(1.0, 1e3, (1, 2500, 33))
    sums = ExactSums(weightings, 33)
    sums.add(slice(0, 33), np.ones((weightings, 2500)), values)
    numbers, shift = sums.integers(slice(0, 33)), sums.shift
    rounded = divide(numbers, np.ones_like(numbers), shift)
    assert rounded.tolist() == [[math.fsum(one) for one in values[0].T]] * weightings


@settings(deadline=None)
@given(st.floats(-1e100, 1e100).filter(lambda x: x == 0.0 or abs(x) > 1e-100))
def test_a_square_is_exact(value: float) -> None:
    high, low = square(np.array([value]))
    assert Fraction(float(high[0])) + Fraction(float(low[0])) == Fraction(value) ** 2


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_only_finite_numbers_are_summed(value: float) -> None:
    with pytest.raises(ValueError, match="only finite numbers"):
        summed([1.0, value])


def test_sums_of_different_shape_do_not_merge() -> None:
    with pytest.raises(ValueError, match=r"cannot merge sums of shape \(1, 2\) into \(1, 1\)"):
        ExactSums(1, 1).merge(ExactSums(1, 2))
