"""How often intervals hold the truth, beside SALib and SciPy on the same samples, and errors.

Functions with closed forms (`tests.testbed.functions.scalar`) are the outputs of one study, once
without failures, once with 5 % of the runs failing at random, and once with every run failing whose
first factor is in the upper fifth of its range. SALib and SciPy take no failures.

Seeds begin at `FIRST_SEED`: on those before it, and on those from 20 000 on, the intervals were
developed (`analysis.sensitivity.estimators.tails`, `analysis.sensitivity.estimators.intervals`), so
they would flatter them. `benchmarks.sensitivity.coverage_tables` prints what is computed here.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from SALib.analyze import sobol as salib_sobol
from scipy.stats import qmc, sobol_indices

from analysis.designs import DEFAULT_SAMPLING, SAMPLINGS, unit_row
from analysis.sensitivity.estimators import MorrisEstimator, SaltelliEstimator
from tests.testbed.functions.scalar import FACTORS, KNOWN, Points

Array = NDArray[np.float64]

SIZES = (64, 256, 1024)
FAILURES = ("none", "5 % at random", "u1 > 0.8")
INDICES = ("first_order", "total_order")
EFFECTS = ("mu", "mu_star", "sigma")
ENDS = ("value", "low", "high")
#: Samples that SALib and SciPy are given too.
SHARED = (DEFAULT_SAMPLING, "latin_hypercube")
LEVEL = 0.9
UPPER_FIFTH = 0.8
FIRST_SEED = 1000

#: By (who, sampling, rows): value, low and high of S and ST, shape (3, 2, kinds of failure,
#: functions, factors). Under "rests on" there are effective numbers of rows instead, without the
#: first two axes.
Found = dict[tuple[str, str, int], Array]


def values_of(points: Points, seed: int) -> Array:
    """Return every function under every kind of failure, shape (rows, width, kinds * functions)."""
    plain = np.stack([known.function(points) for known in KNOWN.values()], axis=-1)
    random = np.random.default_rng(seed).random(plain.shape[:2]) < 0.05
    dependent = points[..., 0] > UPPER_FIFTH
    return np.concatenate(
        [
            plain,
            np.where(random[..., None], np.nan, plain),
            np.where(dependent[..., None], np.nan, plain),
        ],
        axis=-1,
    )


def one_seed(seed: int, samplings: Sequence[str] = SAMPLINGS, rivals: bool = True) -> Found:
    """Return what everyone makes of one seed; SALib and SciPy only if `rivals`, for their time."""
    found: Found = {}
    shape = (3, 2, len(FAILURES), len(KNOWN), FACTORS)
    for sampling in samplings:
        rows = max(SIZES)
        points = np.stack(
            [unit_row("saltelli", sampling, seed, row, FACTORS) for row in range(rows)]
        )
        values = values_of(points, seed)
        estimator = SaltelliEstimator(
            sampling=sampling, seed=seed, factors=FACTORS, outputs=values.shape[-1]
        )
        start = 0
        for stop in SIZES:
            estimator.add_rows(range(start, stop), values[start:stop])
            start = stop
            statistics = estimator.statistics()
            indices = {name: statistic.estimate(LEVEL) for name, statistic in statistics.items()}
            martinez = estimator.compared(LEVEL)["martinez"]
            for who, by_name in (("rehyb", indices), ("Martinez", martinez)):
                ends = [[getattr(by_name[n], end) for n in INDICES] for end in ENDS]
                found[who, sampling, stop] = np.array(ends).reshape(shape)
            tail = statistics["total_order"].tail
            assert tail is not None
            found["rests on", sampling, stop] = tail.rows.reshape(shape[2:])
            if rivals and sampling in SHARED:
                plain = values[:stop, :, : len(KNOWN)]
                found["SALib", sampling, stop] = salib(plain, seed)[:, :, None]
                found["SciPy", sampling, stop] = scipy(plain, seed)[:, :, None]
    return found


def salib(values: Array, seed: int) -> Array:
    """Return (value, low, high) of (S, ST) by SALib, shape (3, 2, outputs, factors)."""
    problem = {"num_vars": FACTORS, "names": list("abcdef"), "bounds": [[0.0, 1.0]] * FACTORS}
    every = []
    for output in range(values.shape[-1]):
        ordered = values[:, [0, *range(2, 2 + FACTORS), 1], output].ravel()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its own, on idle factors
            s = salib_sobol.analyze(
                problem,
                ordered,
                calc_second_order=False,
                conf_level=LEVEL,
                seed=seed,
                num_resamples=200,
            )
        value, half = np.stack([s["S1"], s["ST"]]), np.stack([s["S1_conf"], s["ST_conf"]])
        every.append(np.stack([value, value - half, value + half]))
    return np.stack(every, axis=2)


def scipy(values: Array, seed: int) -> Array:
    """Return (value, low, high) of (S, ST) by SciPy, shape (3, 2, outputs, factors)."""
    result = sobol_indices(
        func={
            "f_A": np.moveaxis(values[:, 0], -1, 0),
            "f_B": np.moveaxis(values[:, 1], -1, 0),
            "f_AB": np.moveaxis(values[:, 2:], (1, 2), (0, 1)),
        },
        n=len(values),
        rng=np.random.default_rng(seed),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, on idle factors
        np.random.seed(seed)  # its bootstrap takes no generator, but NumPy's global one if seeded
        spread = result.bootstrap(confidence_level=LEVEL, n_resamples=200)
    shares = (spread.first_order, spread.total_order)
    return np.stack(
        [
            np.stack([result.first_order, result.total_order]),
            np.stack([share.confidence_interval.low for share in shares]),
            np.stack([share.confidence_interval.high for share in shares]),
        ]
    )


def truths() -> Array:
    """Return the true S and ST, shape (2, kinds of failure, functions, factors).

    If runs fail where one factor is high, those that succeed are a study of that factor's lower
    range: its indices are the truth of the third kind, from 2**16 Sobol points of that range.
    """
    known = [
        np.stack([known.first for known in KNOWN.values()]),
        np.stack([known.total for known in KNOWN.values()]),
    ]
    base = qmc.Sobol(2 * FACTORS, scramble=True, rng=np.random.default_rng(1)).random(2**16)
    a, b = base[:, :FACTORS].copy(), base[:, FACTORS:].copy()
    a[:, 0] *= UPPER_FIFTH
    b[:, 0] *= UPPER_FIFTH
    below: list[list[Array]] = [[], []]
    for function in (known.function for known in KNOWN.values()):
        f_a, f_b = function(a), function(b)
        variance = np.var(np.concatenate([f_a, f_b]))
        first, total = np.empty(FACTORS), np.empty(FACTORS)
        for i in range(FACTORS):
            mixed = a.copy()
            mixed[:, i] = b[:, i]
            moved = function(mixed) - f_a
            first[i] = np.mean((f_b - f_b.mean()) * moved) / variance
            total[i] = 0.5 * np.mean(moved**2) / variance
        below[0].append(first)
        below[1].append(total)
    return np.stack([np.stack([known[i], known[i], np.stack(below[i])]) for i in (0, 1)])


def screened(seed: int) -> Found:
    """Return what elementary effects make of one seed, shape (3, 3, 1, functions, factors)."""
    found: Found = {}
    estimator = MorrisEstimator(
        sampling=DEFAULT_SAMPLING, seed=seed, factors=FACTORS, outputs=len(KNOWN)
    )
    start = 0
    for stop in SIZES:
        estimator.add_rows(range(start, stop), effects_of(seed, range(start, stop)))
        start = stop
        indices = estimator.indices(LEVEL)
        ends = [[getattr(indices[n], end)[None] for n in EFFECTS] for end in ENDS]
        found["rehyb", DEFAULT_SAMPLING, stop] = np.array(ends)
    return found


def effects_of(seed: int, rows: range) -> Array:
    """Return every function at the points of a screening, shape (rows, width, functions)."""
    points = np.stack([unit_row("morris", DEFAULT_SAMPLING, seed, row, FACTORS) for row in rows])
    return np.stack([known.function(points) for known in KNOWN.values()], axis=-1)


def true_effects() -> Array:
    """Return mu, mu* and sigma from 2**17 rows of a seed of its own, shape (3, 1, ...)."""
    estimator = MorrisEstimator(
        sampling=DEFAULT_SAMPLING, seed=0, factors=FACTORS, outputs=len(KNOWN)
    )
    for start in range(0, 2**17, 2**13):
        rows = range(start, start + 2**13)
        estimator.add_rows(rows, effects_of(0, rows))
    indices = estimator.indices(LEVEL)
    return np.stack([indices[name].value[None] for name in EFFECTS])
