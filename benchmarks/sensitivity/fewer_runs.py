"""How many runs a checked surrogate saves, how often its intervals hold, and what fools it.

Functions are evaluated at the first 128, 256, 512 points of a study of method surrogate, until
every 90 % interval of S and ST is as narrow as ±0.02 and believed, or until it gives up and sampled
indices are needed (`analysis.sensitivity.fewer_runs`). Beside it: the runs that a study of method
saltelli needs for ±0.02 (the median of three seeds; 8192 rows and 100 000 runs at most). `python -m
benchmarks.sensitivity.fewer_runs [SEEDS [FIRST SEED [FUNCTION ...]]]` prints it. What was set while
looking was set on the functions under "seen" and seeds from 50 000 on; on all others nothing was.
"""

import sys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from analysis.designs import DEFAULT_SAMPLING, unit_row
from analysis.sensitivity.estimators import SaltelliEstimator
from analysis.sensitivity.fewer_runs.answer import Answer, answer
from analysis.sensitivity.fewer_runs.limits import FEWEST_RUNS, LEAST_EXPLAINED, LOOKS
from analysis.sensitivity.judgement.stopping import SHARE_TARGET
from benchmarks.sensitivity.coverage import FIRST_SEED, LEVEL
from tests.testbed.functions.engineering import ROUGH, SMOOTH
from tests.testbed.functions.hard import HARD, HELD_OUT, Hard

Array = NDArray[np.float64]

SALTELLI_ROWS = tuple(2**m for m in range(7, 14))
SALTELLI_SEEDS, SALTELLI_RUNS = 3, 100_000
#: An index this close to an interval counts as in it: nobody reads it.
CLOSE = 1e-3

_SEEN = ("ishigami", "sobol g", "bratley", "linear", "dummies only", "discontinuity", "rare event")
_HARD = ("exp-sum", "heavy ties", "linear, 20 factors", "Sobol's g, 50 factors", "Pareto 0.3")
GROUPS: Mapping[str, Mapping[str, Hard]] = {
    "seen": {name: HARD[name] for name in _SEEN},
    "smooth": SMOOTH,
    "rough": {**ROUGH, **{name: HARD[name] for name in _HARD}, **HELD_OUT},
}


def holds(found: Answer, truth: tuple[Array, Array]) -> Array:
    """Return whether each interval of S and of ST holds the truth, shape (2, factors)."""
    pairs = zip((found.found.first_order, found.found.total_order), truth, strict=True)
    return np.array([(i.low <= t + CLOSE) & (t - CLOSE <= i.high) for i, t in pairs])


def off(found: Answer, truth: tuple[Array, Array]) -> float:
    """Return by how much the worst index is off."""
    pairs = zip((found.found.first_order, found.found.total_order), truth, strict=True)
    return max(float(np.abs(i.value - t).max()) for i, t in pairs)


def study(hard: Hard, seed: int) -> dict[int, Answer | None]:
    """Return what a study says at each look, until it stops or gives up."""
    said: dict[int, Answer | None] = {}
    for runs in LOOKS:
        x = np.concatenate(
            [unit_row("surrogate", DEFAULT_SAMPLING, seed, r, hard.factors) for r in range(runs)]
        )
        found = said[runs] = answer(x, hard.function(x), seed, LEVEL)
        if stopped(found) or (runs >= FEWEST_RUNS and hopeless(found)):
            break
    return said


def stopped(found: Answer | None) -> bool:
    """Return whether a study stops there."""
    return found is not None and not found.doubt and found.half_width <= SHARE_TARGET


def hopeless(found: Answer | None) -> bool:
    """Return whether a study gives up there."""
    return found is None or found.found.explained < LEAST_EXPLAINED


def saltelli_runs(hard: Hard, seed: int) -> float:
    """Return the runs for ±0.02 on every S and ST of a study of method saltelli."""
    k = hard.factors
    estimator = SaltelliEstimator(sampling=DEFAULT_SAMPLING, seed=seed, factors=k, outputs=1)
    start = 0
    for rows in _sizes(k):
        numbers = range(start, rows)
        x = np.stack([unit_row("saltelli", DEFAULT_SAMPLING, seed, row, k) for row in numbers])
        estimator.add_rows(numbers, hard.function(x)[..., None])
        start = rows
        found = estimator.indices(LEVEL)
        both = (found["first_order"], found["total_order"])
        if max(float(((i.high - i.low) / 2.0).max()) for i in both) <= SHARE_TARGET:
            return rows * (k + 2.0)
    return np.inf


def _sizes(factors: int) -> list[int]:
    """Return the rows at which a study of method saltelli is looked at."""
    return [rows for rows in SALTELLI_ROWS if rows * (factors + 2) <= SALTELLI_RUNS]


def line(name: str, hard: Hard, seeds: range) -> str:
    """Return the line of a function."""
    truth = hard.truth()
    studies = [study(hard, seed) for seed in seeds]
    cells = [f"{name:22s} {hard.factors:3d}"]
    for runs in LOOKS:
        found = [one[runs] for one in studies if one.get(runs) is not None]
        known = [one for one in found if one is not None]
        if not known:
            cells.append(f"{'':>26s}")
            continue
        held = np.mean([holds(one, truth) for one in known], axis=(0, 2))
        cells.append(
            f"{np.median([one.found.explained for one in known]):6.3f} "
            f"±{np.median([one.half_width for one in known]):.3f} "
            f"{held[0]:5.0%} {held[1]:5.0%}"
        )
    last = [list(one.values())[-1] for one in studies]
    ends = [one for one in last if one is not None and stopped(one)]
    runs = np.median([max(one) for one in studies])
    wrong = max((off(one, truth) for one in ends), default=np.nan)
    missed = np.mean([1.0 - holds(one, truth).mean() for one in ends]) if ends else np.nan
    needed = np.median([saltelli_runs(hard, seed) for seed in seeds[:SALTELLI_SEEDS]])
    most = _sizes(hard.factors)[-1] * (hard.factors + 2)
    sampled = f"{needed:9,.0f}" if np.isfinite(needed) else f"> {most:,}".rjust(9)
    cells.append(f"{len(ends):3d}/{len(last):<3d} {runs:4.0f} {missed:6.1%} {wrong:6.3f} {sampled}")
    return " | ".join(cells)


def main(seeds: int = 20, first: int = FIRST_SEED, *names: str) -> None:
    print(f"90 % intervals, target ±{SHARE_TARGET}, seeds {first} to {first + seeds - 1}")
    print("Q2, half width (medians), and how often intervals of S and ST hold the truth, by runs;")
    print("studies that stopped (the others gave up), runs (median), intervals that missed there,")
    print("the worst error there, and runs of a sampled study")
    looks = " | ".join(f"{runs:>4d}: Q2  half    S    ST" for runs in LOOKS)
    print(f"{'function':22s}   k | {looks} | stop    runs  miss  worst   sampled")
    for group, functions in GROUPS.items():
        print(f"{group}:")
        for name, hard in functions.items():
            if names and name not in names:
                continue
            print(line(name, hard, range(first, first + seeds)), flush=True)


if __name__ == "__main__":
    seeds, first = (*map(int, sys.argv[1:3]), *(20, FIRST_SEED)[len(sys.argv[1:3]) :])
    main(seeds, first, *sys.argv[3:])
