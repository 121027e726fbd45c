"""The hard functions of the benchmark have the indices that they say."""

import numpy as np
import pytest

from tests.testbed.functions.hard import HARD, HELD_OUT, sampled
from tests.testbed.functions.level_e import level_e
from tests.testbed.functions.opponents import OPPONENTS

CLOSED = ("rare event", "exp-sum", "Pareto 0.2", "linear, 20 factors", "Laplace", "sine product")


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms_agree_with_many_points(name: str) -> None:
    hard = {**HARD, **OPPONENTS}[name]
    found = sampled(hard, 2**13)
    for closed, by_points in zip((hard.first, hard.total), found, strict=True):
        assert closed is not None
        np.testing.assert_allclose(by_points, closed, atol=0.03)


def test_every_function_is_one_of_the_cube_and_finite() -> None:
    for hard in (*HARD.values(), *HELD_OUT.values(), *OPPONENTS.values()):
        u = np.random.default_rng(1).random((4, 3, hard.factors))
        y = hard.function(u)
        assert y.shape == (4, 3) and np.isfinite(y).all()


def test_level_e_gives_off_iodine_first_and_the_chain_late() -> None:
    """The curve of the benchmark's mean dose: a first peak, a valley, a second one."""
    u = np.random.default_rng(1).random((2000, 12))
    first, valley, second = (level_e(u, years).mean() for years in (3e4, 2e5, 4e6))
    assert first > 3.0 * valley and second > 2.0 * valley
    assert 3e-8 < first < 2e-7
