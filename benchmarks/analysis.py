"""How right the indices are, how honest their intervals, and how fast they stream.

`make bench-analysis`, or `python -m benchmarks.analysis [SEEDS]`; 300 seeds take some 15 minutes
of one idle core.
Functions with closed forms (`benchmarks.functions`) are the outputs of one study, once without
failures, once with 5 % of the runs failing at random, and once with every run failing whose first
factor is in the upper fifth of its range.
"""

import sys
import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from SALib.analyze import sobol as salib_sobol
from scipy.stats import qmc, sobol_indices

from analysis.designs import unit_row
from analysis.estimators import Estimate, Estimator, SaltelliEstimator
from analysis.records import LoggedResult, StudyPlan
from analysis.study_state import StudyState
from benchmarks.functions import FACTORS, KNOWN, Points
from benchmarks.machine import describe_machine

Array = NDArray[np.float64]

SAMPLINGS = ("latin_hypercube", "sobol", "sobol_paired")
SIZES = (64, 256, 1024)
FAILURES = ("none", "5 % at random", "u1 > 0.8")
INDICES = ("first_order", "total_order")
LEVEL = 0.9
UPPER_FIFTH = 0.8


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


def study(sampling: str, seed: int, rows: int) -> tuple[Array, Estimator]:
    """Return values (rows, width, outputs) and the estimator that has seen them."""
    points = np.stack([unit_row("saltelli", sampling, seed, row, FACTORS) for row in range(rows)])
    values = values_of(points, seed)
    estimator = SaltelliEstimator(
        sampling=sampling, seed=seed, factors=FACTORS, outputs=values.shape[-1]
    )
    estimator.add_rows(range(rows), values)
    return values, estimator


def truths() -> dict[str, Array]:
    """Return the true indices, shape (kinds of failure, functions, factors).

    If runs fail where one factor is high, those that succeed are a study of that factor's lower
    range: its indices are the truth of the third kind, from 2**16 Sobol points of that range.
    """
    known = {
        "first_order": np.stack([known.first for known in KNOWN.values()]),
        "total_order": np.stack([known.total for known in KNOWN.values()]),
    }
    base = qmc.Sobol(2 * FACTORS, scramble=True, rng=np.random.default_rng(1)).random(2**16)
    a, b = base[:, :FACTORS].copy(), base[:, FACTORS:].copy()
    a[:, 0] *= UPPER_FIFTH
    b[:, 0] *= UPPER_FIFTH
    below: dict[str, list[Array]] = {name: [] for name in INDICES}
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
        below["first_order"].append(first)
        below["total_order"].append(total)
    return {name: np.stack([known[name], known[name], np.stack(below[name])]) for name in INDICES}


def covers(found: Estimate, truth: Array) -> NDArray[np.bool_]:
    """Return which intervals hold the truth, shape of `truth`."""
    low, high = found.low.reshape(truth.shape), found.high.reshape(truth.shape)
    inside: NDArray[np.bool_] = (low <= truth) & (truth <= high)
    return inside


def print_coverage_and_errors(seeds: int) -> None:
    """Print coverage of 90 % intervals, and errors with the slope of their fall."""
    truth = truths()
    active = truth["total_order"] > 1e-6
    errors: dict[tuple[str, int], Array] = {}
    print(f"\nShare of {LEVEL:.0%} intervals that hold the truth, {seeds} seeds; mean over the")
    print(
        "factors that matter, and the worst factor. 'u1 > 0.8': truth of the range that succeeds,"
    )
    print("and in brackets of the whole range, which is not promised.")
    print(f"{'':16s}{'':14s}" + "".join(f"{name:>26s}" for name in FAILURES))
    for sampling in SAMPLINGS:
        for rows in SIZES:
            inside: dict[str, list[Array]] = {name: [] for name in INDICES}
            whole: dict[str, list[Array]] = {name: [] for name in INDICES}
            off: list[Array] = []
            for seed in range(seeds):
                indices = study(sampling, seed, rows)[1].indices(LEVEL)
                for name in INDICES:
                    inside[name].append(covers(indices[name], truth[name]))
                    plain = np.stack([truth[name][0]] * len(FAILURES))
                    whole[name].append(covers(indices[name], plain))
                off.append(
                    np.stack([indices[n].value.reshape(truth[n].shape) - truth[n] for n in INDICES])
                )
            errors[sampling, rows] = np.sqrt(np.mean(np.square(off), axis=0))
            for name in INDICES:
                cells = []
                for kind in range(len(FAILURES)):
                    share = np.mean(inside[name], axis=0)[kind][active[kind]]
                    cell = f"{share.mean():.3f} (worst {share.min():.2f})"
                    if kind == 2:
                        all_of_it = np.mean(whole[name], axis=0)[kind][active[0]]
                        cell += f" [{all_of_it.mean():.2f}]"
                    cells.append(f"{cell:>26s}")
                print(f"{sampling:16s}{rows:5d} {name[:5]:8s}" + "".join(cells), flush=True)
    print_errors(errors)


def print_errors(errors: dict[tuple[str, int], Array]) -> None:
    """Print root mean square errors without failures, and the power of N that they follow."""
    print("\nRoot mean square error, mean over factors, without failures; slope: error ~ N^slope")
    print(f"{'':16s}{'':14s}{'':8s}" + "".join(f"{n:>8d}" for n in SIZES) + f"{'slope':>8s}")
    for f, function in enumerate(KNOWN):
        for i, index in enumerate(INDICES):
            for sampling in SAMPLINGS:
                found = [float(errors[sampling, rows][i, 0, f].mean()) for rows in SIZES]
                slope = np.polyfit(np.log(SIZES), np.log(found), 1)[0]
                print(
                    f"{sampling:16s}{function:14s}{index[:5]:8s}"
                    + "".join(f"{error:8.4f}" for error in found)
                    + f"{slope:8.2f}"
                )


def print_others(seeds: int, rows: int = 256) -> None:
    """Print SALib and SciPy on the same samples of one function."""
    names = ("ishigami", "sobol g")
    print(f"\nSALib and SciPy on the same samples: Latin hypercube, N = {rows}, {seeds} seeds")
    print(f"{'':24s}{'rms error S':>12s}{'ST':>8s}{'coverage S':>12s}{'ST':>8s}{'ms each':>9s}")
    for function in names:
        known = KNOWN[function]
        truth = np.stack([known.first, known.total])
        active = known.total > 1e-6
        found: dict[str, list[Array]] = {"rehyb": [], "SALib": [], "SciPy": []}
        seconds = dict.fromkeys(found, 0.0)
        for seed in range(seeds):
            points = np.stack(
                [unit_row("saltelli", "latin_hypercube", seed, r, FACTORS) for r in range(rows)]
            )
            values = known.function(points)
            for name, triple in everyone(values, seed):
                started = time.perf_counter()
                found[name].append(triple())
                seconds[name] += time.perf_counter() - started
        for name, estimates in found.items():
            stacked = np.stack(estimates)  # seeds, (value, low, high), (S, ST), factors
            error = np.sqrt(np.mean((stacked[:, 0] - truth) ** 2, axis=0)).mean(axis=-1)
            inside = (stacked[:, 1] <= truth) & (truth <= stacked[:, 2])
            share = inside.mean(axis=0)[:, active].mean(axis=-1)
            print(
                f"{function:12s}{name:12s}{error[0]:12.4f}{error[1]:8.4f}"
                f"{share[0]:12.3f}{share[1]:8.3f}{1e3 * seconds[name] / seeds:9.1f}"
            )


def everyone(values: Array, seed: int) -> Iterator[tuple[str, Callable[[], Array]]]:
    """Yield a name and a function that returns (value, low, high) of S and ST: (3, 2, factors)."""
    rows = len(values)

    def rehyb() -> Array:
        estimator = SaltelliEstimator(
            sampling="latin_hypercube", seed=seed, factors=FACTORS, outputs=1
        )
        estimator.add_rows(range(rows), values[..., None])
        indices = estimator.indices(LEVEL)
        ends = ("value", "low", "high")
        return np.array([[getattr(indices[n], end)[0] for n in INDICES] for end in ends])

    def salib() -> Array:
        problem = {"num_vars": FACTORS, "names": list("abcdef"), "bounds": [[0.0, 1.0]] * FACTORS}
        ordered = values[:, [0, *range(2, 2 + FACTORS), 1]].ravel()
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
        return np.stack([value, value - half, value + half])

    def scipy() -> Array:
        result = sobol_indices(
            func={
                "f_A": values[:, 0][None],
                "f_B": values[:, 1][None],
                "f_AB": values[:, 2:].T[:, None],
            },
            n=rows,
            rng=np.random.default_rng(seed),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its own, on idle factors
            spread = result.bootstrap(confidence_level=LEVEL, n_resamples=200)
        shares = (spread.first_order, spread.total_order)
        return np.stack(
            [
                np.stack([result.first_order, result.total_order]).reshape(2, FACTORS),
                *(
                    np.stack([getattr(s.confidence_interval, end) for s in shares]).reshape(
                        2, FACTORS
                    )
                    for end in ("low", "high")
                ),
            ]
        )

    yield "rehyb", rehyb
    yield "SALib", salib
    yield "SciPy", scipy


def print_speed(rows: int = 1_000_000, batch: int = 2000) -> None:
    """Print how fast rows of 8 evaluations stream, and how long a snapshot takes."""
    rng = np.random.default_rng(1)
    estimator = SaltelliEstimator(sampling="sobol", seed=1, factors=FACTORS, outputs=1)
    values = rng.normal(size=(batch, FACTORS + 2, 1))
    started = time.perf_counter()
    for start in range(0, rows, batch):
        estimator.add_rows(range(start, start + batch), values)
    seconds = time.perf_counter() - started
    size = len(estimator.to_bytes())
    rate = rows * estimator.width / seconds
    print(f"\n{rows:,} rows of {estimator.width} evaluations, 200 replicates, one output:")
    print(f"  {rate:,.0f} evaluations/s, state {size / 1e6:.1f} MB whatever the number of rows")
    plan = StudyPlan(
        id="s",
        method="saltelli",
        seed=1,
        sampling="sobol",
        rows=512,
        factors=tuple("abcdef"),
        outputs=tuple(f"y{o}" for o in range(12)),
    )
    results = [
        LoggedResult(
            seq=1 + row * 8 + position,
            instance="",
            row=row,
            position=position,
            outcome="ok",
            outputs=dict(zip(plan.outputs, rng.normal(size=12).tolist(), strict=True)),
        )
        for row in range(512)
        for position in range(8)
    ]
    state = StudyState(plan)
    started = time.perf_counter()
    state.take(results)
    rate = len(results) / (time.perf_counter() - started)
    started = time.perf_counter()
    state.snapshot()
    snapshot = time.perf_counter() - started
    started = time.perf_counter()
    size = len(state.to_bytes())
    saved = time.perf_counter() - started
    print("A study of 512 rows of 8 evaluations with 12 outputs, as the analysis process keeps it:")
    print(
        f"  {rate:,.0f} results/s; a snapshot takes {1e3 * snapshot:.0f} ms, its state "
        f"({size / 1e6:.1f} MB) {1e3 * saved:.0f} ms"
    )


def main() -> None:
    """Print all tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    print(describe_machine())
    print_coverage_and_errors(seeds)
    print_others(seeds)
    print_speed()


if __name__ == "__main__":
    main()
