"""How often intervals and bands of curves hold the truth, and what a study of curves takes.

`python -m benchmarks.sensitivity.curves [SEEDS]`. Functions are those of
`tests.testbed.functions.curves`, which have closed forms; the truth of elementary effects comes
from a long run on a seed of its own. Seeds begin at 64 000, which nobody had looked at; what is
measured was developed on seeds below 2100 and from 20 000 on.
"""

import sys
from collections.abc import Mapping
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import DEFAULT_SAMPLING, unit_rows
from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.curves.findings import findings
from analysis.sensitivity.curves.points import REPLICATES
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.estimators.weightings import FIRST
from benchmarks.machine import describe_machine
from models.curves import Curve
from tests.testbed.functions.curves import CurveFunction, decays, ishigami_over_time, waves

Array = NDArray[np.float64]

SIZES = (128, 512)
SEEDS = 300
FIRST_SEED = 64_000
LEVEL = 0.9
SCRAMBLES = {"linear": "sobol_blocks", "nested": "owen_blocks"}
WANTED = (0.86, 0.94)
POINTS = 25
FUNCTIONS = {
    "Ishigami over time": ishigami_over_time(POINTS),
    "waves": waves(POINTS),
    "decays": decays(POINTS),
}
SHARES = ("first_order", "total_order")
#: Rows of the run whose elementary effects are taken for true.
LONG_RUN = 2**13
#: A point where a factor does less than this tells nothing of intervals: they may have no width.
LEAST_SHARE = 0.005
#: Rounding of numbers of about 1.
SLACK = 1e-9

#: By what is held and the index's name: whether it was, one entry for each interval or band.
Held = dict[tuple[str, str], list[bool]]


def studied(
    method: str,
    function: CurveFunction,
    seed: int,
    sizes: tuple[int, ...],
    sampling: str = DEFAULT_SAMPLING,
) -> dict[int, dict[str, Any]]:
    """Return the findings after each number of rows of one seed."""
    curve = CurveEstimator(
        method=method,
        sampling=sampling,
        seed=seed,
        factors=function.factors,
        points=POINTS,
    )
    found, start = {}, 0
    for stop in sizes:
        for first in range(start, stop, 1024):
            rows = range(first, min(first + 1024, stop))
            points = unit_rows(method, sampling, seed, rows, function.factors)
            curve.add_rows(rows, function.values(points))
        start = stop
        names = [str(factor) for factor in range(function.factors)]
        found[stop] = findings("y", Curve(points=POINTS, over="time"), curve, names, LEVEL)
    return found


def judge(found: Mapping[str, Any], truth: Mapping[str, Any], held: Held) -> None:
    """Add whether the intervals and bands of one study hold the truth."""
    for index, true in truth["points"].items():
        for f, line in enumerate(found["factors"].values()):
            low, high, band_low, band_high = (
                np.array(line[index][end]) for end in ("low", "high", "band_low", "band_high")
            )
            moves = np.abs(true[:, f]) > truth["least"][index]
            if not moves.any():
                continue
            inside = (low - SLACK <= true[:, f]) & (true[:, f] <= high + SLACK)
            exact = truth["exact"][:, f] if "exact" in truth else np.zeros_like(moves)
            held.setdefault(("every point", index), []).extend(inside[moves & ~exact].tolist())
            if index != "sigma" and (moves & exact).any():
                held.setdefault(("known exactly", index), []).extend(inside[moves & exact].tolist())
            # A point without any influence must be held as well, whatever its width.
            all_in = (band_low - SLACK <= true[:, f]) & (true[:, f] <= band_high + SLACK)
            if not exact.all():
                held.setdefault(("whole band", index), []).append(bool(all_in.all()))
    parts = {"generalised": found["whole"]["factors"]}
    for c, one in enumerate(found["components"][:2]):
        parts[f"score {c + 1}"] = one["factors"]
    for part, factors in parts.items():
        for index, true_of in truth.get(part, {}).items():
            for f, entry in enumerate(factors.values()):
                if "exact" in truth and truth["exact"][:, f].all():
                    continue
                if abs(true_of[f]) > truth["least"].get(index, LEAST_SHARE):
                    ends = entry[index]
                    held.setdefault((part, index), []).append(
                        ends["low"] - SLACK <= true_of[f] <= ends["high"] + SLACK
                    )


def shares_of(function: CurveFunction) -> dict[str, dict[str, Any]]:
    """Return the closed forms of a function's shares."""
    of = {"first_order": function.first, "total_order": function.total}
    return {
        "points": {index: function.at_points(part) for index, part in of.items()},
        "generalised": {index: function.of_whole(part) for index, part in of.items()},
        "score 1": {index: function.of_score(part, 0) for index, part in of.items()},
        "score 2": {index: function.of_score(part, 1) for index, part in of.items()},
        "least": dict.fromkeys(of, LEAST_SHARE),
    }


def effects_of(function: CurveFunction) -> dict[str, Any]:
    """Return the elementary effects of a long run, in which linear scrambles err least."""
    found = studied("morris", function, 7, (LONG_RUN,), SCRAMBLES["linear"])[LONG_RUN]
    factors = found["factors"].values()
    points = {
        index: np.array([line[index]["value"] for line in factors]).T
        for index in ("mu", "mu_star", "sigma")
    }
    whole = [entry["mu_star"]["value"] for entry in found["whole"]["factors"].values()]
    least = 0.02 * float(np.max(points["mu_star"]))
    return {
        "points": points,
        "generalised": {"mu_star": np.array(whole)},
        # Effects that are all the same have no sampling error that an interval could miss.
        "exact": points["sigma"] <= SLACK * np.max(points["mu_star"]),
        "least": dict.fromkeys(points, least),
    }


def print_coverage(seeds: int) -> None:
    """Print how often intervals and bands hold the truth."""
    print(f"Coverage of 90 % intervals and bands, {seeds} seeds, {POINTS} points, ", end="")
    print(f"`{DEFAULT_SAMPLING}`\n")
    head = " | ".join(f"N = {size}" for size in SIZES)
    outside = cells = 0
    print(f"| Function | What is held | Index | {head} |\n|{'---|' * (3 + len(SIZES))}")
    for name, function in FUNCTIONS.items():
        for method, truth in (
            ("saltelli", shares_of(function)),
            ("morris", effects_of(function)),
        ):
            held: dict[int, Held] = {size: {} for size in SIZES}
            for seed in range(FIRST_SEED, FIRST_SEED + seeds):
                for size, found in studied(method, function, seed, SIZES).items():
                    judge(found, truth, held[size])
            for part, index in held[SIZES[0]]:
                shares = [float(np.mean(held[size][part, index])) for size in SIZES]
                shown = " | ".join(f"{share:.3f}" for share in shares)
                print(f"| {name} | {part} | {index} | {shown} |", flush=True)
                if part != "known exactly":
                    cells += len(shares)
                    outside += sum(not WANTED[0] <= share <= WANTED[1] for share in shares)
    print(f"\n{outside} of {cells} cells are outside {WANTED[0]} to {WANTED[1]}.")


def print_scrambles(seeds: int) -> None:
    """Print what the scramble of the same points does to intervals of the waves' effects."""
    function = FUNCTIONS["waves"]
    truth = effects_of(function)
    print("\nIntervals at every point of waves, by the scramble of the eight sequences\n")
    columns = "held | half width, median | error, root mean square | error, median"
    print(f"| Index | N | Scramble | {columns} |\n|{'---|' * 7}")
    found: dict[tuple[str, int, str], list[Array]] = {}
    for scramble, sampling in SCRAMBLES.items():
        for seed in range(FIRST_SEED, FIRST_SEED + seeds):
            effects = MorrisEstimator(
                sampling=sampling,
                seed=seed,
                factors=function.factors,
                outputs=POINTS,
                weightings=FIRST + REPLICATES,
            )
            start = 0
            for size in SIZES:
                rows = range(start, size)
                points = unit_rows("morris", sampling, seed, rows, function.factors)
                effects.add_rows(rows, function.values(points))
                start = size
                for index, one in effects.indices(LEVEL).items():
                    ends = np.stack([one.low, one.value, one.high])
                    found.setdefault((index, size, scramble), []).append(ends)
    for (index, size, scramble), studies in sorted(found.items()):
        true = truth["points"][index]
        counts = (np.abs(true) > truth["least"][index]) & ~truth["exact"]
        low, value, high = np.moveaxis(np.stack(studies)[:, :, counts], 1, 0)
        held = (low - SLACK <= true[counts]) & (true[counts] <= high + SLACK)
        error = np.abs(value - true[counts])
        print(
            f"| {index} | {size} | {scramble} | {held.mean():.3f} "
            f"| {np.median(high - low) / 2:.2g} "
            f"| {np.sqrt((error**2).mean()):.2g} | {np.median(error):.2g} |",
            flush=True,
        )


def print_cost(runs: int = 1_000_000) -> None:
    """Print what a study of six factors and 101 points takes, by its state after many runs."""
    curve = CurveEstimator(
        method="saltelli", sampling=DEFAULT_SAMPLING, seed=1, factors=6, points=101
    )
    batch = 500
    values = np.random.default_rng(1).normal(size=(batch, 8, 101)).cumsum(axis=-1)
    rows = min(runs // 8, 20 * batch)
    started = process_time()
    for start in range(0, rows, batch):
        curve.add_rows(range(start, start + batch), values)
    rate = 8 * rows / (process_time() - started)
    before = len(curve.to_bytes())
    # Doubling by merging: what a million runs sum to, without the time that they take to add.
    merged = 8 * rows
    while merged < runs:
        other = CurveEstimator(
            method="saltelli", sampling=DEFAULT_SAMPLING, seed=1, factors=6, points=101
        )
        other.load_bytes(curve.to_bytes())
        curve.merge(other)
        merged *= 2
    started = process_time()
    findings("y", Curve(points=101, over="time"), curve, list("abcdef"), LEVEL)
    taken = process_time() - started
    print(
        f"\nSix factors, 101 points: {rate:,.0f} runs per second of processor time; the state is "
        f"{before / 1e6:.1f} MB after {8 * rows:,} runs and {len(curve.to_bytes()) / 1e6:.1f} MB "
        f"after {merged:,} (the sums doubled by merging); a snapshot takes {taken:.2f} s."
    )


def print_beside_salib(rows: int = 512) -> None:
    """Print how long S and ST of every point take us and SALib, from the same runs."""
    from SALib.analyze import sobol

    values = np.random.default_rng(1).normal(size=(rows, 8, 101)).cumsum(axis=-1)
    started = process_time()
    curve = CurveEstimator(
        method="saltelli", sampling=DEFAULT_SAMPLING, seed=1, factors=6, points=101
    )
    curve.add_rows(range(rows), values)
    findings("y", Curve(points=101, over="time"), curve, list("abcdef"), LEVEL)
    ours = process_time() - started
    problem = {"num_vars": 6, "names": list("abcdef"), "bounds": [[0.0, 1.0]] * 6}
    started = process_time()
    for point in range(101):
        ordered = values[:, [0, *range(2, 8), 1], point].ravel()
        sobol.analyze(problem, ordered, calc_second_order=False, seed=1)
    theirs = process_time() - started
    print(
        f"{rows} rows at once: {ours:.2f} s of processor time with bands, generalised indices and "
        f"components; SALib, point by point, {theirs:.2f} s for S and ST of the points."
    )


def main() -> None:
    """Print all tables."""
    print(describe_machine())
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print_coverage(seeds)
    print_scrambles(seeds)
    print_cost()
    print_beside_salib()


if __name__ == "__main__":
    main()
