"""How often intervals hold the truth where that is hard, and how often a study warns.

Studies of `tests.testbed.functions.hard` are taken through the analysis as in a coordinator: their
snapshots, the decision to go on or to stop (at 128 rows and each doubling, since none stops before;
to ±0.1, and for effects to a tenth of the largest mu*; 2048 rows at most), and what they say of
themselves. `make bench-analysis` prints it, `python -m benchmarks.sensitivity.hard [SEEDS]
[FIRST SEED]` this alone. Seeds begin at `FIRST_SEED`; what was set while looking at results was set
on seeds from 40 000 on.
"""

import os
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from analysis.designs import DEFAULT_SAMPLING, unit_row
from analysis.designs.radial import SMALLEST_STEP
from analysis.sensitivity.judgement.stopping import Goal, next_step
from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.snapshot import new_estimator, take_snapshot
from benchmarks.sensitivity.coverage import FIRST_SEED
from tests.testbed.functions.hard import HARD, HELD_OUT, Hard

Array = NDArray[np.float64]

INDICES = {"saltelli": ("first_order", "total_order"), "morris": ("mu", "mu_star", "sigma")}
SYMBOLS = {"first_order": "S", "total_order": "ST", "mu": "mu", "mu_star": "mu*", "sigma": "sigma"}
SIZES = {"saltelli": (64, 256, 1024), "morris": (20, 64, 256, 1024)}
LOOKS = (128, 256, 512, 1024, 2048)
TARGET = {"saltelli": 0.1, "morris": None}
#: Wanted of the coverage of 90 % intervals, or else of the share of the studies that warn.
HONEST = (0.86, 0.94)
WARNED, WRONGLY = 0.95, 0.02
#: A factor of less than this share of the largest index does not matter.
IDLE = 1e-4

#: By (method, function, rows or "stop"): "low" and "high" (indices, factors), "warned", "reached".
Found = dict[tuple[str, str, object], dict[str, Any]]


def one_seed(
    method: str, names: tuple[str, ...], seed: int, functions: Mapping[str, Hard]
) -> Found:
    """Return what studies say of functions of as many factors, by one seed, at every size."""
    factors = functions[names[0]].factors
    plan = StudyPlan(
        id="s",
        method=method,
        seed=seed,
        sampling=DEFAULT_SAMPLING,
        rows=max(LOOKS),
        factors=tuple(map(str, range(factors))),
        outputs=names,
    )
    estimator, found, start = new_estimator(plan), Found(), 0
    for rows in sorted({*SIZES[method], *LOOKS}):
        numbers = range(start, rows)
        points = np.stack([unit_row(method, plan.sampling, seed, r, factors) for r in numbers])
        values = np.stack([functions[name].function(points) for name in names], axis=-1)
        ok = np.zeros_like(values[..., :1])
        estimator.add_rows(numbers, np.concatenate([values, ok], axis=-1))
        start = rows
        shot = take_snapshot(
            plan,
            estimator,
            [],
            cursor=0,
            rows_complete=rows,
            evaluations={"ok": rows * values.shape[1]},
        )
        for name in names:
            described = _described(shot, method, name)
            if rows in SIZES[method]:
                found[method, name, rows] = described
            if rows in LOOKS and (method, name, "stop") not in found:
                goal = Goal(output=name, target=TARGET[method], up_to=max(LOOKS))
                step = next_step(shot, goal, rows)
                if step is not None and step.rows is None:
                    found[method, name, "stop"] = described | {
                        "reached": step.reached,
                        "rows": rows,
                    }
    return found


def _described(snapshot: Mapping[str, Any], method: str, name: str) -> dict[str, Any]:
    output = snapshot["outputs"][name]
    factors = output["factors"].values()

    def ends(end: str) -> Array:
        found = [[f[index][end] for f in factors] for index in INDICES[method]]
        return np.array(found, dtype=np.float64)

    return {
        "low": ends("low"),
        "high": ends("high"),
        "value": ends("value"),
        "warned": output.get("trust", {}).get("trusted") is False,
        "idle": output["screening"]["non_influential"],
    }


def true_effects(hard: Hard, rows: int) -> Array:
    """Return mu, mu* and sigma of a function from as many Sobol rows, shape (3, factors)."""
    k = hard.factors
    unit = qmc.Sobol(2 * k, scramble=True, rng=np.random.default_rng(2)).random(rows)
    base, effects = hard.function(unit[:, :k]), []
    for i in range(k):
        moved = unit[:, :k].copy()
        step = SMALLEST_STEP + (1.0 - 2.0 * SMALLEST_STEP) * unit[:, k + i]
        moved[:, i] = np.where(unit[:, i] + step < 1.0, unit[:, i] + step, unit[:, i] + step - 1.0)
        effects.append((hard.function(moved) - base) / (moved[:, i] - unit[:, i]))
    found = np.array(effects)
    return np.stack([found.mean(axis=1), np.abs(found).mean(axis=1), found.std(axis=1)])


def truth_of(method: str, hard: Hard) -> Array:
    """Return the true indices, shape (indices, factors)."""
    if method == "saltelli":
        return np.stack(hard.truth())
    return true_effects(hard, 2**17 if hard.factors < 12 else 2**15)


def all_seeds(method: str, seeds: range, functions: Mapping[str, Hard]) -> dict[Any, list[Any]]:
    """Return `one_seed` of every seed, as lists by key."""
    by_factors: dict[int, list[str]] = {}
    for name, hard in functions.items():
        by_factors.setdefault(hard.factors, []).append(name)
    every: dict[Any, list[Any]] = {}
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        jobs = [
            pool.submit(one_seed, method, tuple(names), seed, functions)
            for names in by_factors.values()
            for seed in seeds
        ]
        for job in jobs:
            for key, one in job.result().items():
                every.setdefault(key, []).append(one)
    return every


def print_hard(seeds: range, functions: Mapping[str, Hard] = HARD) -> None:
    """Print coverage and warnings of every function, at every size and where studies stopped."""
    for method in INDICES:
        print_found(method, all_seeds(method, seeds, functions), functions, seeds)


def print_found(
    method: str, every: Mapping[Any, list[Any]], functions: Mapping[str, Hard], seeds: range
) -> None:
    """Print what `all_seeds` returned."""
    names = INDICES[method]
    print(f"\n{method}: seeds from {seeds[0]} to {seeds[-1]} at most. Coverage, mean over the")
    print("factors that matter (least factor), and the share of the studies that warn. Effects")
    print("that are the same in every row are exact, and not counted.\n")
    head = ["Function", "N", "seeds", *(SYMBOLS[n] for n in names), "warned", "met"]
    print("| " + " | ".join(head) + " |")
    print("|---" * len(head) + "|")
    for name, hard in functions.items():
        truth = truth_of(method, hard)
        for size in (*SIZES[method], "stop"):
            print(_line(every.get((method, name, size), []), name, hard, size, truth))


def _line(found: list[dict[str, Any]], name: str, hard: Hard, size: object, truth: Array) -> str:
    """Return a line of the table; where studies stopped, of those that reached their target."""
    studies, of = found, len(found)
    label = f"{size}"
    if size == "stop":
        found = [one for one in found if one["reached"]]
        rows = int(np.median([one["rows"] for one in found])) if found else 0
        label = f"stopped ({len(found) / max(of, 1):.0%}, at {rows})"
    if not found:
        return f"| {name} | {label} | {of} |" + " – |" * (len(truth) + 1) + " yes |"
    low, high = (np.stack([one[end] for one in found]) for end in ("low", "high"))
    # An effect that is the same everywhere has a sigma of 0, and of rounding in the computer.
    slack = 1e-9 * np.max(np.abs(truth))
    held = np.mean((low <= truth + slack) & (truth - slack <= high), axis=0)
    active = np.max(np.abs(truth), axis=0) > IDLE * np.max(np.abs(truth))
    # Of an effect that every row agrees on nothing is left to err: it is held, or wrong.
    exact = np.all(held == 1.0, axis=0) & np.all(high - low <= slack, axis=(0, 1))
    shares = [one[active & ~exact] for one in held]
    warned = float(np.mean([one["warned"] for one in studies]))
    cells = [f"{one.mean():.3f} ({one.min():.2f})" if one.size else "exact" for one in shares]
    honest = all(HONEST[0] <= one.mean() <= HONEST[1] for one in shares if one.size)
    met = honest and warned <= WRONGLY if hard.kind else honest or warned >= WARNED
    verdict = "yes" if met else "NO"
    return f"| {name} | {label} | {of} | {' | '.join(cells)} | {warned:.2f} | {verdict} |"


def main() -> None:
    """Print the tables."""
    asked = [int(one) for one in sys.argv[1:]]
    seeds, first = asked + [200, FIRST_SEED][len(asked) :]
    print_hard(range(first, first + seeds))
    print("\nFunctions on which nothing was set")
    print_hard(range(first, first + seeds), HELD_OUT)


if __name__ == "__main__":
    main()
