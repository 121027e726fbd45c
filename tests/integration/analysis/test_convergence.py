"""Statistical promises: indices of known functions come out, and intervals cover them."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.designs import unit_row
from analysis.sensitivity.estimators import Estimator, estimator_class
from tests.testbed.functions.scalar import KNOWN, bratley

Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]

#: Ishigami and Homma 1990 with a = 7, b = 0.1; closed forms of Saltelli et al. 2008, page 179.
ISHIGAMI_FIRST = np.array([0.3139, 0.4424, 0.0])
ISHIGAMI_TOTAL = np.array([0.5576, 0.4424, 0.2437])

#: Shares of the runs that fail, of the outputs of one study.
FAILING = (0.0, 0.05)

#: Sobol's g-function.
G = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0])


def ishigami(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Ishigami's function at points (..., 3) of the unit cube, shape (...)."""
    x1, x2, x3 = np.moveaxis(np.pi * (2.0 * u - 1.0), -1, 0)
    return np.sin(x1) + 7.0 * np.sin(x2) ** 2 + 0.1 * x3**4 * np.sin(x1)


def sobol_g(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Sobol's g-function at points (..., 6) of the unit cube, shape (...)."""
    return np.prod((np.abs(4.0 * u - 2.0) + G) / (1.0 + G), axis=-1)


def g_indices() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return first- and total-order indices of Sobol's g-function."""
    partial = 1.0 / (3.0 * (1.0 + G) ** 2)
    whole = np.prod(1.0 + partial)
    return partial / (whole - 1.0), partial / (1.0 + partial) * whole / (whole - 1.0)


def study(
    method: str,
    function: Function,
    *,
    rows: int,
    seed: int,
    sampling: str = "owen_blocks",
    failing: tuple[float, ...] = (0.0,),
) -> Estimator:
    """Return the estimator of a study, with an output for each share of runs that fail at random.

    Outputs know nothing of each other: each is as in a study of its own, which takes as long.
    """
    factors = 3 if function is ishigami else 6
    points = np.stack([unit_row(method, sampling, seed, row, factors) for row in range(rows)])
    values = np.repeat(function(points)[..., None], len(failing), axis=-1)
    chance = np.random.default_rng(seed).random(values.shape[:2])
    values[chance[..., None] < failing] = np.nan
    estimator = estimator_class(method)(
        sampling=sampling, seed=seed, factors=factors, outputs=len(failing)
    )
    estimator.add_rows(range(rows), values)
    return estimator


@pytest.mark.parametrize(
    ("function", "first", "total"),
    [(ishigami, ISHIGAMI_FIRST, ISHIGAMI_TOTAL), (sobol_g, *g_indices())],
)
def test_indices_converge_to_their_closed_forms(
    function: Function, first: NDArray[np.float64], total: NDArray[np.float64]
) -> None:
    """Failed runs at random cost precision, and shift nothing."""
    found = study("saltelli", function, rows=8192, seed=6, failing=(0.0, 0.02)).indices()
    for output, tolerance in enumerate((0.004, 0.03)):
        np.testing.assert_allclose(found["first_order"].value[output], first, atol=tolerance)
        np.testing.assert_allclose(found["total_order"].value[output], total, atol=tolerance)


@pytest.mark.parametrize("sampling", ["owen_blocks", "sobol", "latin_hypercube"])
def test_first_order_is_unbiased_over_seeds(sampling: str) -> None:
    found = np.stack(
        [
            study("saltelli", ishigami, rows=64, seed=seed, sampling=sampling)
            .indices()["first_order"]
            .value[0]
            for seed in range(200)
        ]
    )
    error = found.std(axis=0, ddof=1) / np.sqrt(len(found))
    assert np.all(np.abs(found.mean(axis=0) - ISHIGAMI_FIRST) < 4.0 * error + 0.01)


def test_a_sobol_design_is_worth_several_latin_hypercubes() -> None:
    """Root mean square errors over seeds at the same cost."""
    error = {
        sampling: np.sqrt(
            np.mean(
                [
                    (
                        study("saltelli", ishigami, rows=1024, seed=seed, sampling=sampling)
                        .indices()["total_order"]
                        .value[0]
                        - ISHIGAMI_TOTAL
                    )
                    ** 2
                    for seed in range(20)
                ]
            )
        )
        for sampling in ("sobol", "owen_blocks", "latin_hypercube")
    }
    assert error["sobol"] < 0.5 * error["latin_hypercube"]
    assert error["owen_blocks"] < 0.8 * error["latin_hypercube"]


@pytest.mark.parametrize("function", [ishigami, sobol_g])
def test_intervals_of_variance_shares_cover_the_truth(function: Function) -> None:
    """Nine times in ten, which 150 seeds tell to 0.025, for every factor that is not idle."""
    first, total = g_indices() if function is sobol_g else (ISHIGAMI_FIRST, ISHIGAMI_TOTAL)
    truth = {"first_order": first, "total_order": total}
    covered: dict[str, list[NDArray[np.bool_]]] = {name: [] for name in truth}
    for seed in range(150):
        found = study("saltelli", function, rows=128, seed=seed, failing=FAILING).indices()
        for name, value in truth.items():
            covered[name].append((found[name].low <= value) & (value <= found[name].high))
    shares = np.stack([np.mean(inside, axis=0) for inside in covered.values()])
    for share, failing in zip(np.moveaxis(shares, 1, 0), FAILING, strict=True):
        assert np.all((share >= 0.82) & (share <= 0.97)), (failing, share)
        assert np.mean(share) == pytest.approx(0.9, abs=0.025), failing


def test_heavy_tails_of_few_rows_are_covered_no_less_than_others_and_no_more() -> None:
    """Of Bratley's function, by 64 rows: the kurtosis of differences goes from 3 to 46."""
    known = KNOWN["bratley"]
    held = []
    for seed in range(300):
        found = study("saltelli", bratley, rows=64, seed=seed).indices()
        for name, truth in (("first_order", known.first), ("total_order", known.total)):
            held.append((found[name].low[0] <= truth) & (truth <= found[name].high[0]))
    share = np.mean(np.reshape(held, (300, 2, 6)), axis=0)
    assert np.all((share >= 0.83) & (share <= 0.96)), share
    assert np.mean(share) == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("function", [ishigami, sobol_g])
def test_intervals_of_pairs_cover_the_truth(function: Function) -> None:
    """Nine times in ten, for the pairs of factors that matter; three of the g-function's do."""
    partial = 1.0 / (3.0 * (1.0 + G[:3]) ** 2)
    together = np.array([partial[0] * partial[1], partial[0] * partial[2], partial[1] * partial[2]])
    of_g = together / (np.prod(1.0 + 1.0 / (3.0 * (1.0 + G) ** 2)) - 1.0)
    truth, pairs = (of_g, [0, 1, 5]) if function is sobol_g else ([0.0, 0.2437, 0.0], [0, 1, 2])
    covered = []
    for seed in range(150):
        of = study("saltelli_second_order", function, rows=128, seed=seed, failing=FAILING)
        found = of.indices()["second_order"]
        covered.append((found.low[:, pairs] <= truth) & (truth <= found.high[:, pairs]))
    for share, failing in zip(np.mean(covered, axis=0), FAILING, strict=True):
        assert np.all((share >= 0.82) & (share <= 0.97)), (failing, share)


def test_intervals_of_one_sobol_sequence_are_too_wide() -> None:
    """What the default is for: at the same size its intervals are narrower, and no less true."""
    width: dict[str, list[NDArray[np.float64]]] = {"sobol": [], "owen_blocks": []}
    for sampling, widths in width.items():
        for seed in range(10):
            found = study("saltelli", sobol_g, rows=1024, seed=seed, sampling=sampling).indices()
            widths.append(found["total_order"].high[0] - found["total_order"].low[0])
    medians = {sampling: np.median(widths, axis=0) for sampling, widths in width.items()}
    assert np.all(medians["owen_blocks"][:3] < 0.7 * medians["sobol"][:3])


@cache
def many_effects(function: Function) -> dict[str, NDArray[np.float64]]:
    """Return the indices of so many rows that they are the truth."""
    found = study("morris", function, rows=16384, seed=10**6).indices()
    return {name: index.value[0] for name, index in found.items()}


@pytest.mark.parametrize("rows", [10, 50])
@pytest.mark.parametrize("function", [ishigami, sobol_g])
def test_intervals_of_elementary_effects_cover_the_truth(function: Function, rows: int) -> None:
    """Already from ten rows; but sigma needs more."""
    truth = many_effects(function)
    names = ("mu", "mu_star") if rows == 10 else ("mu", "mu_star", "sigma")
    covered: dict[str, list[NDArray[np.bool_]]] = {name: [] for name in names}
    for seed in range(150):
        found = study("morris", function, rows=rows, seed=seed).indices()
        for name, inside in covered.items():
            value = truth[name]
            inside.append((found[name].low[0] <= value) & (value <= found[name].high[0]))
    for name, inside in covered.items():
        assert np.all(np.mean(inside, axis=0) >= 0.8), (name, np.mean(inside, axis=0))


def test_effects_of_the_g_function_rank_its_factors() -> None:
    found = study("morris", sobol_g, rows=200, seed=2).indices()["mu_star"]
    assert np.all(np.diff(found.value[0, :5]) < 0.0)
    assert np.all(found.high[0, 1:5] < found.value[0, :4])
