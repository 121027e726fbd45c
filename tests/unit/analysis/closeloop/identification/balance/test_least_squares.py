"""Least squares with bounds, and columns that add nothing."""

import numpy as np
import pytest

from analysis.closeloop.identification.balance.least_squares import keep_independent, solve


def test_columns_that_others_explain_are_dropped() -> None:
    rng = np.random.default_rng(1)
    base = rng.standard_normal((500, 2))
    new = rng.standard_normal(500)
    columns = np.column_stack([base @ [1.0, 2.0], new, new + 1e-4 * base[:, 0]])
    assert keep_independent(base, columns)[1] == (1,)


def test_a_bounded_coefficient_stays_at_zero() -> None:
    rng = np.random.default_rng(2)
    x = rng.standard_normal((300, 2))
    table = np.column_stack([x, x @ [2.0, -1.0]])
    assert solve(table.T @ table, np.array([-np.inf, -np.inf])) == pytest.approx([2.0, -1.0])
    held = solve(table.T @ table, np.array([-np.inf, 0.0]))
    assert held[1] == 0.0 and held[0] == pytest.approx(
        float(x[:, 0] @ table[:, 2] / (x[:, 0] @ x[:, 0]))
    )
