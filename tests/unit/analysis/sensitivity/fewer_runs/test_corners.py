"""What two factors do near their ends together tells what one run there may stand for."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.sensitivity.fewer_runs.corners import in_corners
from analysis.sensitivity.fewer_runs.parts import MIDDLES

Array = NDArray[np.float64]


def together(function: Callable[[Array, Array], Array], share: float = 0.1) -> Array:
    """Return the part of the second order of a function, with a share of the variance."""
    part = function(MIDDLES[:, None], MIDDLES)
    part = part - part.mean(axis=0) - part.mean(axis=1)[:, None] + part.mean()
    return (part * np.sqrt(share / part.var()))[None]


POLE = together(lambda a, b: (a + b) ** -0.6)


@pytest.mark.parametrize(
    ("part", "least", "most"),
    [
        (together(lambda a, b: a * b, 0.5), 0.0, 0.0005),
        (together(lambda a, b: np.sin(np.pi * a * b), 0.24), 0.0, 0.002),
        (together(lambda a, b: np.sin(6.28 * a) * (2.0 * b - 1.0) ** 4, 0.24), 0.0, 0.002),
        (together(lambda a, b: 1.0 * ((a > 0.4) & (b > 0.6))), 0.0, 0.0005),
        (POLE, 0.005, 0.05),
        (together(lambda a, b: 1.0 / (0.02 + a + b)), 0.005, 0.05),
    ],
    ids=["a product", "a bend", "Ishigami's", "a jump inside", "a pole", "a peak"],
)
def test_a_corner_that_is_too_steep_is_told_from_what_is_smooth(
    part: Array, least: float, most: float
) -> None:
    assert least <= in_corners(part, 256) <= most


def test_every_corner_of_every_pair_is_looked_at() -> None:
    found = in_corners(POLE, 256)
    for turned in (POLE[:, ::-1], POLE[:, :, ::-1], POLE[:, ::-1, ::-1]):
        flat = np.zeros_like(POLE)
        assert in_corners(np.concatenate([flat, turned, flat]), 256) == pytest.approx(found)


def test_it_is_a_share_of_the_variance_and_falls_with_the_number_of_runs() -> None:
    assert in_corners(2.0 * POLE, 256) == pytest.approx(4.0 * in_corners(POLE, 256))
    # Sides of 1/16 and 1/32: two and three times as the variation falls from 1/2 to 1/4.
    once, twice, wide = (in_corners(POLE, runs) for runs in (256, 1024, 64))
    assert wide > once > twice > 0.3 * once
    assert once / wide == pytest.approx(twice / once)


def test_a_part_that_is_flat_at_a_corner_or_of_one_factor_alone_stands_for_nothing() -> None:
    assert in_corners(np.zeros((3, 16, 16)), 256) == 0.0
    assert in_corners(np.zeros((0, 16, 16)), 256) == 0.0


def test_it_is_the_variation_in_the_two_boxes_of_a_corner() -> None:
    """Squares of alternating signs vary by 1 in both boxes: a sixteenth, and a quarter of that."""
    cells = np.add.outer(np.arange(16), np.arange(16))
    chequered = np.where(cells % 2, 1.0, -1.0)[None]
    assert in_corners(chequered, 256) == pytest.approx(0.25**2 * 0.25**2)
    # What varies in the inner box alone falls by hardly anything.
    inner = np.zeros((1, 16, 16))
    inner[0, 1, 1] = 1.0
    found = 0.25**2 * (1.0 / 16.0 - 1.0 / 16.0**2)
    fall = found / (0.5**2 * (1.0 / 64.0 - 1.0 / 64.0**2))
    assert 0.9 < fall < 1.0 and in_corners(inner, 256) == pytest.approx(found * fall**2)
