"""Nested scrambles: Sobol points whose errors are normal, each reached without walking."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kurtosis, qmc

from analysis.designs import unit_rows
from analysis.designs.nested import BITS, _directions, _sobol, nested

Words = NDArray[np.uint64]


def sequence(points: int, dimensions: int, seed: int = 1) -> tuple[Words, NDArray[np.float64]]:
    """Return the first points of a sequence without its scramble, as digits, and with it."""
    index = np.arange(points, dtype=np.uint64)
    words = np.random.Philox(seed).random_raw(dimensions)
    keys = np.broadcast_to(words, (points, dimensions))
    return _sobol(index, dimensions), nested(index, keys)


def test_without_scramble_points_are_those_of_scipy() -> None:
    digits, _ = sequence(2048, 40)
    expected = qmc.Sobol(40, scramble=False, bits=BITS).random(2048)
    assert (digits * 0.5**BITS == expected).all()


def test_digits_that_two_points_share_at_the_front_they_share_scrambled() -> None:
    """And the first in which they differ they differ in: this makes a scramble nested."""
    digits, points = sequence(256, 3)
    scrambled = np.floor(points * 2.0**BITS).astype(np.uint64)
    for plain, moved in zip(digits.T, scrambled.T, strict=True):
        apart, still = (one[:, None] ^ one for one in (plain, moved))
        shared, kept = (np.frexp(one.astype(np.float64))[1] for one in (apart, still))
        assert np.array_equal(shared, kept)


def test_every_digit_is_flipped_half_of_the_time_and_apart_from_others() -> None:
    """Of 32 cells, over 2000 keys: where each of their points goes on the next level."""
    index = np.arange(32, dtype=np.uint64)
    keys = np.random.default_rng(3).integers(2**64, size=(2000, 1), dtype=np.uint64)
    points = np.stack([nested(index, np.broadcast_to(key, (32, 1)))[:, 0] for key in keys])
    order = np.argsort(_sobol(index, 1)[:, 0])
    # The sixth digit, of points in the order of the cells that they are in without scramble.
    sixth = (np.floor(points[:, order] * 64) % 2) * 2.0 - 1.0
    assert np.abs(sixth.mean(axis=0)).max() < 4.5 / np.sqrt(2000)
    together = sixth.T @ sixth / 2000 - np.eye(32)
    assert np.abs(together).max() < 4.5 / np.sqrt(2000)


@pytest.mark.parametrize("points", [16, 64])
def test_the_mean_of_a_line_errs_as_owen_has_it_and_normally(points: int) -> None:
    """Each of n points lies anywhere in its n-th: the mean has a variance of 1 / (12 n^3)."""
    errors = np.concatenate(
        [sequence(points, 20, seed)[1].mean(axis=0) - 0.5 for seed in range(50)]
    )
    scaled = errors * np.sqrt(12.0 * points**3)
    # The standard error of both, of a thousand normal numbers, is 0.022 and 0.15.
    assert scaled.std() == pytest.approx(1.0, abs=0.1)
    assert abs(kurtosis(scaled)) < 0.6


def test_sequences_do_not_agree_on_the_mean_of_an_effect_that_is_linear_in_another_factor() -> None:
    """As linearly scrambled ones do, of which most know it exactly and few have all the error."""
    exact = {}
    for sampling in ("owen_blocks", "sobol_blocks"):
        base = unit_rows("morris", sampling, 4, range(512), 2)[:, 0, 1]
        means = base.reshape(64, 8).mean(axis=0)
        exact[sampling] = int((np.abs(means - 0.5) < 1e-9).sum())
    assert exact["owen_blocks"] == 0 and exact["sobol_blocks"] >= 2


def test_a_point_far_out_takes_one_walk_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    walked: list[int] = []
    walk = qmc.Sobol.fast_forward

    def counted(engine: qmc.Sobol, n: int) -> qmc.Sobol:
        walked.append(n)
        found: qmc.Sobol = walk(engine, n)
        return found

    monkeypatch.setattr(qmc.Sobol, "fast_forward", counted)
    _directions.cache_clear()
    far = 2**22
    for row in [far, 5, far + 9000, far - 2**20]:
        unit_rows("morris", "owen_blocks", 97, [row], 2)
    assert sum(walked) < far
