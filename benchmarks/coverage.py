"""How often intervals hold the truth, beside SALib and SciPy on the same samples, and errors.

Functions with closed forms (`benchmarks.functions`) are the outputs of one study, once without
failures, once with 5 % of the runs failing at random, and once with every run failing whose first
factor is in the upper fifth of its range. SALib and SciPy take no failures.

An exactly honest interval at 90 % holds the truth in 0.87 to 0.93 of 300 seeds nine times in ten,
since the binomial error is 0.017; so 92 % of the cells (function, factor) lie there by luck alone.
"""

import os
import warnings
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray
from SALib.analyze import sobol as salib_sobol
from scipy.stats import qmc, sobol_indices

from analysis.designs import SAMPLINGS, unit_row
from analysis.estimators import SaltelliEstimator
from benchmarks.functions import FACTORS, KNOWN, Points

Array = NDArray[np.float64]

SIZES = (64, 256, 1024)
FAILURES = ("none", "5 % at random", "u1 > 0.8")
INDICES = ("first_order", "total_order")
#: Samples that SALib and SciPy are given too.
SHARED = ("sobol_blocks", "latin_hypercube")
LEVEL = 0.9
HONEST = (0.87, 0.93)
UPPER_FIFTH = 0.8

#: By (who, sampling, rows): value, low and high of S and ST, shape (3, 2, kinds of failure,
#: functions, factors).
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


def one_seed(seed: int) -> Found:
    """Return what everyone makes of one seed."""
    found: Found = {}
    shape = (3, 2, len(FAILURES), len(KNOWN), FACTORS)
    for sampling in SAMPLINGS:
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
            indices = estimator.indices(LEVEL)
            ours = [[getattr(indices[n], end) for n in INDICES] for end in ("value", "low", "high")]
            found["rehyb", sampling, stop] = np.array(ours).reshape(shape)
            if sampling in SHARED:
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


def coverage(found: Array, truth: Array) -> Array:
    """Return the share of the seeds whose interval holds the truth.

    Args:
        found: value, low and high of every seed, shape (seeds, 3, ...).
        truth: shape (...).
    """
    share: Array = np.mean((found[:, 1] <= truth) & (truth <= found[:, 2]), axis=0)
    return share


def print_coverage_and_errors(seeds: int) -> None:
    """Print coverage of 90 % intervals, and errors with the slope of their fall."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        every = list(pool.map(one_seed, range(seeds), chunksize=4))
    found = {key: np.stack([one[key] for one in every]) for key in every[0]}
    truth = truths()
    active = truth[1] > 1e-6
    print(f"\nShare of {LEVEL:.0%} intervals that hold the truth, {seeds} seeds: mean over the")
    print("functions and the factors that matter (worst factor), share of these cells within")
    print(f"{HONEST[0]} to {HONEST[1]}. 'u1 > 0.8': truth of the range that succeeds, in brackets")
    print("of the whole range, which is not promised. Half width: median, without failures.")
    print(f"{'':37s}half width" + "".join(f"{name:>23s}" for name in FAILURES))
    for (who, sampling, rows), estimates in found.items():
        kinds = estimates.shape[3]
        for i, name in enumerate(INDICES):
            share = coverage(estimates[:, :, i], truth[i, :kinds])
            cells = [f"{described(share[k][active[k]]):>23s}" for k in range(kinds)]
            if kinds > 2:
                whole = coverage(estimates[:, :, i, 2], truth[i, 0])
                cells[2] += f" [{whole[active[0]].mean():.2f}]"
            half = 0.5 * np.median(estimates[:, 2, i, 0] - estimates[:, 1, i, 0], axis=0)
            width = f"{half[active[0]].mean():10.3f}"
            print(f"{who:6s}{sampling:16s}{rows:5d} {name[:5]:9s}{width}" + "".join(cells))
    print_functions({key: share for key, share in found.items() if key[0] == "rehyb"}, truth)
    print_errors(found, truth)


def described(share: Array) -> str:
    """Return the mean, the worst and how much is within `HONEST`."""
    honest = np.mean((share >= HONEST[0] - 1e-9) & (share <= HONEST[1] + 1e-9))
    return f"{share.mean():.3f} ({share.min():.2f}) {honest:4.0%}"


def print_functions(found: Mapping[tuple[str, str, int], Array], truth: Array) -> None:
    """Print coverage by function: mean over its factors that matter (worst factor)."""
    active = truth[1] > 1e-6
    print("\nThe same by function")
    print(f"{'':46s}" + "".join(f"{name:>15s}" for name in KNOWN))
    for (_, sampling, rows), estimates in found.items():
        for i, name in enumerate(INDICES):
            for k, kind in enumerate(FAILURES):
                share = coverage(estimates[:, :, i, k], truth[i, k])
                cells = [share[f][active[k, f]] for f in range(len(KNOWN))]
                print(
                    f"{sampling:16s}{rows:5d} {name[:5]:9s}{kind:15s}"
                    + "".join(f"{f'{c.mean():.3f} ({c.min():.2f})':>15s}" for c in cells)
                )


def print_errors(found: Mapping[tuple[str, str, int], Array], truth: Array) -> None:
    """Print root mean square errors without failures, and the power of N that they follow."""
    active = truth[1, 0] > 1e-6
    print("\nRoot mean square error, mean over the factors that matter, without failures, and the")
    print("power of N that it follows. SALib's S is centred otherwise; every other value is ours.")
    print(f"{'':45s}" + "".join(f"{n:>8d}" for n in SIZES) + f"{'slope':>8s}")
    for f, function in enumerate(KNOWN):
        for i, index in enumerate(INDICES):
            for who, sampling in dict.fromkeys((who, sampling) for who, sampling, _ in found):
                if who == "SciPy" or (who == "SALib" and index == "total_order"):
                    continue
                off = [found[who, sampling, n][:, 0, i, 0, f] - truth[i, 0, f] for n in SIZES]
                errors = [np.sqrt(np.mean(one**2, axis=0))[active[f]].mean() for one in off]
                slope = np.polyfit(np.log(SIZES), np.log(errors), 1)[0]
                print(
                    f"{who:6s}{sampling:16s}{function:14s}{index[:5]:9s}"
                    + "".join(f"{error:8.4f}" for error in errors)
                    + f"{slope:8.2f}"
                )
