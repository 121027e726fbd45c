"""What a design promises: rows that are pure functions of (seed, row), and that fill the cube."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, qmc

from analysis.designs import (
    BLOCKS,
    METHODS,
    SAMPLINGS,
    blocks_of,
    fewest_factors,
    instance_parameters,
    row_width,
    unit_row,
    unit_rows,
)
from analysis.designs.blocks import IN_TURN
from analysis.designs.distributions import LogUniform, Normal, Uniform
from analysis.designs.points import LATIN_HYPERCUBE_ROWS, _sobol_points, sobol
from analysis.designs.radial import SMALLEST_STEP, legs
from analysis.designs.streams import Purpose, bits, bits_of
from analysis.designs.trajectories import TRAJECTORIES

SEEDS = st.integers(0, 2**64 - 1)
EVERY_DESIGN = list(product(METHODS, SAMPLINGS))


@settings(deadline=None)
@given(st.sampled_from(EVERY_DESIGN), SEEDS, st.integers(0, 10_000), st.integers(1, 8))
def test_every_point_lies_strictly_inside_the_cube(
    design: tuple[str, str], seed: int, row: int, factors: int
) -> None:
    factors = max(factors, fewest_factors(design[0]))
    points = unit_row(*design, seed, row, factors)
    assert points.shape == (row_width(design[0], factors), factors)
    assert np.all((points > 0.0) & (points < 1.0))


@pytest.mark.parametrize(
    ("method", "sampling"), [*EVERY_DESIGN, *(("morris", walk) for walk in TRAJECTORIES)]
)
def test_many_rows_at_once_are_those_that_are_asked_for_one_by_one(
    method: str, sampling: str
) -> None:
    rows = [2000, 0, 7, 8, 7, 1_000_003, 51]
    together = unit_rows(method, sampling, 5, rows, 3)
    each = [unit_row(method, sampling, 5, row, 3) for row in rows]
    assert together.tobytes() == np.stack(each).tobytes()
    assert unit_rows(method, sampling, 5, [], 3).shape == (0, *each[0].shape)


@pytest.mark.parametrize("sampling", IN_TURN)
@pytest.mark.parametrize("rows", [[-1], [3, -1], [2**31]])
def test_rows_that_no_design_has_are_refused_among_others_too(
    sampling: str, rows: list[int]
) -> None:
    with pytest.raises(ValueError, match="row"):
        unit_rows("morris", sampling, 5, rows, 3)


def test_bits_are_those_of_a_fresh_generator_whatever_was_drawn_before() -> None:
    asked = [
        (3, Purpose.ORDER, 9, 7),
        (2**64 - 1, Purpose.BAND, 2**63, 2),
        (3, Purpose.ORDER, 9, 7),
    ]
    for seed, purpose, index, size in asked:
        fresh = np.random.Philox(
            key=np.array([seed, index], dtype=np.uint64),
            counter=np.array([0, 0, 0, purpose], dtype=np.uint64),
        )
        assert bits(seed, purpose, index, size).tolist() == fresh.random_raw(size).tolist()


def test_bits_of_many_streams_are_those_of_each() -> None:
    indices = [9, 0, 2**64 - 1, 9]
    together = bits_of(3, Purpose.BOOTSTRAP, indices, 5)
    for index, words in zip(indices, together, strict=True):
        assert words.tolist() == bits(3, Purpose.BOOTSTRAP, index, 5).tolist()
    assert bits_of(3, Purpose.BOOTSTRAP, [], 5).shape == (0, 5)
    for wrong in ([0, -1], [2**64, 0]):
        with pytest.raises(ValueError, match="index must be an integer from 0"):
            bits_of(3, Purpose.BOOTSTRAP, wrong, 5)


@pytest.mark.parametrize(
    ("sampling", "a", "b"),
    [
        (
            "sobol",
            [0.029702758882194757, 0.14377051452174783],
            [0.4557941979728639, 0.7172231269069016],
        ),
        (
            "owen_blocks",
            [0.3087653783150017, 0.2092131651006639],
            [0.3134595178999007, 0.8842423944734037],
        ),
        (
            "sobol_blocks",
            [0.16672840947285295, 0.0008645723573863506],
            [0.04309090552851558, 0.3287875889800489],
        ),
        (
            "latin_hypercube",
            [0.3219559884424454, 0.8351825113045952],
            [0.8712331956556557, 0.735673902696706],
        ),
    ],
)
def test_rows_stay_the_same_from_release_to_release(
    sampling: str, a: list[float], b: list[float]
) -> None:
    """Nothing of a running study may move under a new version of this code, NumPy or SciPy."""
    assert unit_row("saltelli", sampling, 1, 60, 2)[:2].tolist() == [a, b]


@settings(deadline=None)
@given(st.sampled_from(EVERY_DESIGN), SEEDS, st.integers(0, 3000))
def test_another_seed_is_another_design(design: tuple[str, str], seed: int, row: int) -> None:
    other = (seed + 1) % 2**64
    assert not np.array_equal(unit_row(*design, seed, row, 3), unit_row(*design, other, row, 3))


@settings(deadline=None)
@given(st.sampled_from(SAMPLINGS), SEEDS, st.integers(0, 3000), st.integers(1, 8))
def test_a_radial_row_moves_one_factor_at_a_time_and_never_by_little(
    sampling: str, seed: int, row: int, factors: int
) -> None:
    points = unit_row("morris", sampling, seed, row, factors)
    moved = points[1:] != points[0]
    assert np.array_equal(moved, np.eye(factors, dtype=bool))
    size = np.abs(legs(points)[1])
    assert np.all((size >= SMALLEST_STEP - 1e-15) & (size <= 1.0 - SMALLEST_STEP + 1e-15))


@settings(deadline=None)
@given(st.sampled_from(SAMPLINGS), SEEDS, st.integers(0, 3000), st.integers(1, 8))
def test_a_saltelli_row_is_a_then_b_then_a_with_one_column_of_b(
    sampling: str, seed: int, row: int, factors: int
) -> None:
    a, b, *mixed = unit_row("saltelli", sampling, seed, row, factors)
    for i, point in enumerate(mixed):
        expected = a.copy()
        expected[i] = b[i]
        assert np.array_equal(point, expected)


@pytest.mark.parametrize(("method", "sampling"), EVERY_DESIGN)
def test_every_position_is_uniform_over_many_rows(method: str, sampling: str) -> None:
    """A moved point is a draw of the distributions too: its outputs count for the moments."""
    rows = unit_rows(method, sampling, 11, range(1000), 2)
    for position, factor in product(range(rows.shape[1]), range(2)):
        assert kstest(rows[:, position, factor], "uniform").pvalue > 1e-3


def test_every_block_of_a_latin_hypercube_has_one_point_in_every_stratum() -> None:
    for block in (0, 1, 7):
        rows = range(block * LATIN_HYPERCUBE_ROWS, (block + 1) * LATIN_HYPERCUBE_ROWS)
        points = np.stack([unit_row("saltelli", "latin_hypercube", 3, row, 4)[0] for row in rows])
        strata = np.sort(np.floor(points * LATIN_HYPERCUBE_ROWS).astype(int), axis=0)
        assert np.array_equal(strata, np.tile(np.arange(LATIN_HYPERCUBE_ROWS)[:, None], 4))


def test_a_sobol_design_fills_the_cube_more_evenly_than_random_points() -> None:
    points = np.stack([unit_row("saltelli", "sobol", 3, row, 4)[:2].ravel() for row in range(256)])
    random = np.random.default_rng(1).random(points.shape)
    assert qmc.discrepancy(points) < 0.5 * qmc.discrepancy(random)


def test_a_sobol_design_is_balanced_across_blocks() -> None:
    """Any 1024 points of a block have one in each of 1024 strata, of every coordinate."""
    rows = range(1024, 2048)
    points = np.stack([unit_row("saltelli", "sobol", 9, row, 2)[0] for row in rows])
    strata = np.sort(np.floor(points * 1024).astype(int), axis=0)
    assert np.array_equal(strata, np.tile(np.arange(1024)[:, None], 2))


def test_parameters_are_quantiles_in_position_order() -> None:
    distributions = {
        "length": Uniform(low=0.2, high=0.4),
        "mass": Normal(mean=1.0, sd=0.1),
        "stiffness": LogUniform(low=100.0, high=1000.0),
    }
    points = instance_parameters("saltelli", "sobol", 1, 5, distributions)
    unit = unit_row("saltelli", "sobol", 1, 5, 3)
    assert [list(point) for point in points] == [list(distributions)] * 5
    for i, (name, distribution) in enumerate(distributions.items()):
        values = [point[name] for point in points]
        assert values == pytest.approx(distribution.ppf(unit[:, i]).tolist(), rel=1e-15)
        assert values[0] == values[2 + (i + 1) % 3], "a factor that is not moved keeps its bits"
        assert all(type(value) is float for value in values)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("fast", "sobol", 1, 0, 2), "unknown method 'fast': expected one of morris, saltelli"),
        (
            ("morris", "grid", 1, 0, 2),
            "unknown sampling 'grid' of morris: expected one of owen_blocks, sobol_blocks",
        ),
        (("morris", "sobol", -1, 0, 2), "seed must be an integer from 0"),
        (("morris", "latin_hypercube", 2**64, 0, 2), "seed must be an integer from 0"),
        (("morris", "sobol", 1, -1, 2), "row must not be negative"),
        (("morris", "sobol", 1, 2**30, 2), "row of a Sobol design must be from 0"),
        (("morris", "sobol", 1, 0, 0), "must vary at least one factor"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(
    arguments: tuple[str, str, int, int, int], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        unit_row(*arguments)


def test_a_paired_sobol_row_takes_a_factors_coordinates_from_neighbouring_dimensions() -> None:
    plain = unit_row("saltelli", "sobol", 9, 77, 4)
    together = np.stack([plain[0], plain[1]]).ravel()
    paired = unit_row("saltelli", "sobol_paired", 9, 77, 4)
    assert np.array_equal(paired[0], together[0::2])
    assert np.array_equal(paired[1], together[1::2])


def test_pairing_brings_squared_differences_closer_to_their_mean() -> None:
    """Half of their mean is what a total-order index of a linear factor is made of: 1/12."""
    worst = {
        sampling: max(
            float(np.sqrt(np.mean((np.mean(squares(sampling, seed), axis=0) - 1 / 6) ** 2)))
            for seed in range(12)
        )
        for sampling in ("sobol", "sobol_paired")
    }
    assert worst["sobol_paired"] < 0.6 * worst["sobol"]


def squares(sampling: str, seed: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Return squared differences of A and B over 64 rows of 6 factors."""
    rows = np.stack([unit_row("saltelli", sampling, seed, row, 6)[:2] for row in range(64)])
    return np.asarray((rows[:, 0] - rows[:, 1]) ** 2)


@pytest.mark.parametrize("sampling", IN_TURN)
def test_every_block_is_a_sobol_sequence_of_its_own(sampling: str) -> None:
    """16 rows of a block have one point in each of 16 strata of every coordinate."""
    rows = np.stack([unit_row("saltelli", sampling, 9, row, 3)[:2] for row in range(128)])
    for block in range(BLOCKS):
        strata = np.floor(rows[block::BLOCKS].reshape(16, 6) * 16).astype(int)
        assert np.array_equal(np.sort(strata, axis=0), np.tile(np.arange(16)[:, None], 6))


@pytest.mark.parametrize("sampling", IN_TURN)
def test_blocks_err_independently_of_each_other(sampling: str) -> None:
    """Means of one coordinate over 4 points of each block, of 200 seeds, are not correlated."""
    means = np.stack(
        [
            unit_rows("morris", sampling, seed, range(32), 1)[:, 0].reshape(4, BLOCKS).mean(axis=0)
            for seed in range(200)
        ]
    )
    correlation = np.corrcoef(means.T)
    np.fill_diagonal(correlation, 0.0)
    assert np.max(np.abs(correlation)) < 4.0 / np.sqrt(200)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_eight_neighbours_belong_to_eight_blocks(sampling: str) -> None:
    blocks = blocks_of(sampling, 5, range(80)).reshape(10, BLOCKS)
    assert np.array_equal(np.sort(blocks, axis=1), np.tile(np.arange(BLOCKS), (10, 1)))
    shuffled = [70, 3, 12, 3]
    expected = blocks.ravel()[shuffled]
    assert np.array_equal(blocks_of(sampling, 5, shuffled), expected)
    in_turn = np.all(blocks == np.arange(BLOCKS))
    assert in_turn == (sampling in IN_TURN), "rows of other designs are dealt at random"


def test_a_study_of_a_hundred_million_rows_is_not_walked_through_for_every_lease(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SciPy walks to a point: from the beginning that took 0.7 s at row 10**8."""
    walked: list[int] = []
    walk = qmc.Sobol.fast_forward

    def counted(engine: qmc.Sobol, n: int) -> qmc.Sobol:
        walked.append(n)
        found: qmc.Sobol = walk(engine, n)
        return found

    monkeypatch.setattr(qmc.Sobol, "fast_forward", counted)
    far = 2**22
    # Leases go on, the analysis follows, and now and then somebody looks elsewhere.
    for row in [
        far,
        far + 1024,
        5,
        far - 2**20,
        far + 2048,
        far - 2**20 + 1024,
        77_777,
        far + 3072,
    ]:
        sobol(97, row, 2)
    assert sum(walked) < 3 * far


def test_a_point_is_the_same_from_wherever_it_is_reached() -> None:
    rows = [300_000, 1, 299_000, 70_000, 140_000, 210_000, 280_000, 350_000, 300_000]
    straight = qmc.Sobol(3, scramble=True, bits=30, rng=np.random.Generator(np.random.PCG64(11)))
    every = straight.random(2**19)
    for row in rows:
        _sobol_points.cache_clear()
        assert (sobol(11, row, 3) == every[row] + 0.5**31).all()
