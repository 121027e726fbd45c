"""A trial carries something only if a load takes most of what the model leaves of it."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.judgement.loads import _share

SECONDS, RATE = 12, 20


def rows(seconds: int = SECONDS) -> Rows:
    """Return rows of one trial of one joint, a block for every second."""
    block = np.repeat(np.arange(seconds), RATE)
    own = SimpleNamespace(
        trial=np.zeros(len(block), dtype=int),
        block=block,
        joint_of_block=np.zeros(seconds, dtype=int),
    )
    return cast(Rows, own)


@pytest.mark.parametrize(
    ("mass", "beside", "shows"),
    [(1.0, 0.2, True), (1.0, 3.0, False), (-1.0, 0.2, False), (0.0, 0.2, False)],
)
def test_a_load_shows_if_it_takes_most_and_has_a_mass(
    mass: float, beside: float, shows: bool
) -> None:
    rng = np.random.default_rng(0)
    load = rng.standard_normal((SECONDS * RATE, 4))
    left = load @ np.array([mass, 0.3 * mass, 0.0, 0.0])
    left = left + beside * rng.standard_normal(len(left))
    assert (_share(left, load, rows(), 0) > 0.0) is shows


def test_a_few_seconds_show_no_load() -> None:
    load = np.random.default_rng(0).standard_normal((3 * RATE, 4))
    assert _share(load[:, 0], load, rows(3), 0) == 0.0
