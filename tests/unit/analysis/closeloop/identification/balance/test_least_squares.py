"""Least squares with bounds, and columns that add nothing."""

import numpy as np
import pytest

from analysis.closeloop.identification.balance.least_squares import (
    fits_without_each,
    gram_matrices,
    inverse_of,
    keep_independent,
    solve,
    sums_of_others,
)


def test_columns_that_others_explain_are_dropped() -> None:
    rng = np.random.default_rng(1)
    base = rng.standard_normal((500, 2))
    new = rng.standard_normal(500)
    columns = np.column_stack([base @ [1.0, 2.0], new, new + 1e-4 * base[:, 0]])
    assert keep_independent(base, columns)[1] == (1,)


def test_a_column_that_no_row_has_gets_zero_and_leaves_the_others_alone() -> None:
    # As where the one second that holds a backlash is left out.
    rng = np.random.default_rng(3)
    x = np.column_stack([rng.standard_normal((200, 2)), np.zeros(200)])
    table = np.column_stack([x, x[:, :2] @ [2.0, -1.0]])
    gram = table.T @ table
    assert solve(gram, np.full(3, -np.inf)) == pytest.approx([2.0, -1.0, 0.0])
    inverse = inverse_of(np.stack([gram[:3, :3]]))[0]
    assert inverse[:2, :2] == pytest.approx(np.linalg.inv(gram[:2, :2]))
    assert not inverse[2].any() and not inverse[:, 2].any()


def test_a_bounded_coefficient_stays_at_zero() -> None:
    rng = np.random.default_rng(2)
    x = rng.standard_normal((300, 2))
    table = np.column_stack([x, x @ [2.0, -1.0]])
    assert solve(table.T @ table, np.array([-np.inf, -np.inf])) == pytest.approx([2.0, -1.0])
    held = solve(table.T @ table, np.array([-np.inf, 0.0]))
    assert held[1] == 0.0 and held[0] == pytest.approx(
        float(x[:, 0] @ table[:, 2] / (x[:, 0] @ x[:, 0]))
    )


def test_a_bounded_coefficient_stays_at_a_bound_below_zero_and_the_others_allow_for_it() -> None:
    rng = np.random.default_rng(2)
    x = rng.standard_normal((300, 2)) + 0.5
    target = x @ [2.0, -1.0]
    gram = np.column_stack([x, target]).T @ np.column_stack([x, target])
    assert solve(gram, np.array([-np.inf, -1.5])) == pytest.approx([2.0, -1.0])
    held = solve(gram, np.array([-np.inf, -0.7]))
    rest = target + 0.7 * x[:, 1]
    assert held == pytest.approx([float(x[:, 0] @ rest / (x[:, 0] @ x[:, 0])), -0.7])


def test_fits_without_each_part_are_those_that_are_solved_one_by_one() -> None:
    rng = np.random.default_rng(4)
    table = rng.standard_normal((120, 4))
    table[:, 3] = table[:, :3] @ [2.0, 0.1, -0.1] + rng.standard_normal(120)
    grams = gram_matrices(table, np.arange(120).reshape(12, 10))
    lower = np.array([-np.inf, 0.0, 0.0])
    *without, whole = fits_without_each(grams, lower)
    total = grams.sum(axis=0)
    held = 0
    for gram, (fit, left) in zip([*(total - grams), total], [*without, whole], strict=True):
        alone = solve(gram, lower)
        held += int(np.any(alone[1:] == 0.0))
        assert fit.tolist() == alone.tolist()
        free = np.flatnonzero(alone != 0.0)
        unbound = np.linalg.solve(gram[np.ix_(free, free)], gram[free, 3])
        # The ridge is 1e-10 of a column.
        assert fit[free] == pytest.approx(unbound, abs=1e-8)
        residual = np.append(-fit, 1.0)
        assert left == pytest.approx(residual @ gram @ residual)
    assert 0 < held < len(grams) + 1 == len(without) + 1


def test_where_every_coefficient_is_held_or_there_is_none_nothing_is_solved() -> None:
    table = np.random.default_rng(5).standard_normal((60, 1)) @ [[1.0, 1.0, -3.0]]
    gram = table.T @ table
    assert solve(gram, np.zeros(2)).tolist() == [0.0, 0.0]
    ((fit, left),) = fits_without_each(gram[None, 2:, 2:], np.empty(0))[1:]
    assert len(fit) == 0 and left == gram[2, 2]


def test_a_column_of_one_part_alone_is_exactly_zero_without_it() -> None:
    rng = np.random.default_rng(3)
    table = rng.standard_normal((90, 3))
    parts = np.arange(90).reshape(3, 30)
    table[30:, 0] = 0.0
    found = sums_of_others(gram_matrices(table, parts))
    assert not found[0, 0].any() and not found[0, :, 0].any() and found[0, 1, 1] > 0.0
    for own, gram in zip(parts, found, strict=True):
        others = np.delete(table, own, axis=0)
        assert gram == pytest.approx(others.T @ others, rel=1e-12, abs=1e-12)
