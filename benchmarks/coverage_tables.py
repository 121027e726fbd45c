"""What `benchmarks.coverage` finds, as tables: honesty of intervals, their widths, and errors.

Of 1000 seeds an exactly honest interval at 90 % holds the truth in 0.88 to 0.92 of 19 cells in 20
(binomial error 0.0095), of 300 seeds in 0.87 to 0.93 of nine in ten (0.017).
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from analysis.remarks import FEWEST_ROWS
from benchmarks.coverage import (
    EFFECTS,
    FAILURES,
    FIRST_SEED,
    INDICES,
    LEVEL,
    SHARED,
    SIZES,
    Array,
    Found,
    one_seed,
    screened,
    true_effects,
    truths,
)
from benchmarks.functions import KNOWN

HONEST = (0.87, 0.93)
#: An index or effect below this is that of an idle factor, which is exactly 0.
IDLE = 1e-6


def print_coverage_and_errors(seeds: int, with_rivals: int) -> None:
    """Print coverage of 90 % intervals, and errors with the slope of their fall.

    Args:
        seeds: how many.
        with_rivals: how many of them, the first ones, SALib and SciPy get too.
    """
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    asked = [number < FIRST_SEED + with_rivals for number in numbers]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        effects = pool.submit(true_effects)
        every = list(pool.map(one_seed, numbers, asked, chunksize=4))
        screening = stacked(list(pool.map(screened, numbers[:with_rivals], chunksize=4)))
        of_effects = effects.result()
    found, truth = stacked(every), truths()
    print(
        f"\nSeeds {numbers[0]} to {numbers[-1]}; SALib, SciPy and screening: the first "
        f"{with_rivals} of them."
    )
    print(f"Share of {LEVEL:.0%} intervals that hold the truth: mean over the functions and the")
    print(
        "factors that matter (worst factor), share of these cells within "
        f"{HONEST[0]} to {HONEST[1]}."
    )
    print("'u1 > 0.8': truth of the range that succeeds, in brackets of the whole range, which is")
    print("not promised. Half width: median, without failures.")
    print(f"{'':37s}half width" + "".join(f"{name:>23s}" for name in FAILURES))
    for key in found:
        if key[0] in ("rehyb", "Martinez"):
            print_lines(key, found[key], truth, INDICES)
    print(f"\nThe first {with_rivals} seeds, all on the same samples, without failures")
    for sampling in SHARED:
        for rows in SIZES:
            for who in ("rehyb", "SALib", "SciPy"):
                first = found[who, sampling, rows][:with_rivals, :, :, :1]
                print_lines((who, sampling, rows), first, truth[:, :1], INDICES)
    print("\nElementary effects, without failures")
    for key, estimates in screening.items():
        print_lines(key, estimates, of_effects, EFFECTS)
    ours = {key: share for key, share in found.items() if key[0] == "rehyb"}
    print_functions(ours, truth)
    print_few_rows(found, truth)
    print_errors({key: one for key, one in found.items() if key[0] != "rests on"}, truth)


def stacked(every: Sequence[Found]) -> Found:
    """Return what was found of each seed, as far as it was, along a new first axis."""
    return {key: np.stack([one[key] for one in every if key in one]) for key in every[0]}


def print_lines(
    key: tuple[str, str, int], estimates: Array, truth: Array, names: Sequence[str]
) -> None:
    """Print one line per index: width, and coverage under each kind of failure."""
    who, sampling, rows = key
    kinds = estimates.shape[3]
    active = np.abs(truth[1]) > IDLE
    for i, name in enumerate(names):
        share = coverage(estimates[:, :, i], truth[i, :kinds])
        cells = [f"{described(share[k][active[k]]):>23s}" for k in range(kinds)]
        if kinds > 2:
            whole = coverage(estimates[:, :, i, 2], truth[i, 0])
            cells[2] += f" [{whole[active[0]].mean():.2f}]"
        widths = (estimates[:, 2, i, 0] - estimates[:, 1, i, 0])[:, active[0]]
        width = f"{0.5 * np.nanmedian(widths, axis=0).mean():9.4f}"
        print(f"{who:9s}{sampling:16s}{rows:5d} {name[:7]:7s}{width}" + "".join(cells))


def coverage(found: Array, truth: Array) -> Array:
    """Return the share of the seeds whose interval holds the truth.

    Args:
        found: value, low and high of every seed, shape (seeds, 3, ...).
        truth: shape (...), to twelve digits, since effects of a linear function are all the same.
    """
    slack = 1e-12 * np.abs(truth)
    share: Array = np.mean((found[:, 1] <= truth + slack) & (truth - slack <= found[:, 2]), axis=0)
    return share


def described(share: Array) -> str:
    """Return the mean, the worst and how much is within `HONEST`."""
    honest = np.mean((share >= HONEST[0] - 1e-9) & (share <= HONEST[1] + 1e-9))
    return f"{share.mean():.3f} ({share.min():.2f}) {honest:4.0%}"


def print_functions(found: Mapping[tuple[str, str, int], Array], truth: Array) -> None:
    """Print coverage by function: mean over its factors that matter (worst factor)."""
    active = truth[1] > IDLE
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


def print_few_rows(found: Found, truth: Array) -> None:
    """Print how honest the intervals of ST are where a study would say that few rows make it up."""
    print(
        f"\nIntervals of ST where it rests on fewer than {FEWEST_ROWS:g} rows, as remarks have it"
    )
    for (who, sampling, rows), behind in found.items():
        if who != "rests on":
            continue
        estimates = found["rehyb", sampling, rows][:, :, 1]
        held = (estimates[:, 1] <= truth[1]) & (truth[1] <= estimates[:, 2])
        few = behind < FEWEST_ROWS
        there = few.sum() > 0
        print(
            f"{sampling:16s}{rows:5d}  {few[:, truth[1] > IDLE].mean():6.2%} of the indices"
            + (f", of which {held[few].mean():.2f} hold the truth" if there else "")
        )


def print_errors(found: Found, truth: Array) -> None:
    """Print root mean square errors without failures, and the power of N that they follow."""
    active = truth[1, 0] > IDLE
    print("\nRoot mean square error, mean over the factors that matter, without failures, and the")
    print("power of N that it follows. SciPy's values are ours, and so is SALib's ST.")
    print(f"{'':48s}" + "".join(f"{n:>8d}" for n in SIZES) + f"{'slope':>8s}")
    for f, function in enumerate(KNOWN):
        for i, index in enumerate(INDICES):
            for who, sampling in dict.fromkeys((who, sampling) for who, sampling, _ in found):
                if who == "SciPy" or (who == "SALib" and index == "total_order"):
                    continue
                off = [found[who, sampling, n][:, 0, i, 0, f] - truth[i, 0, f] for n in SIZES]
                errors = [np.sqrt(np.mean(one**2, axis=0))[active[f]].mean() for one in off]
                slope = np.polyfit(np.log(SIZES), np.log(errors), 1)[0]
                print(
                    f"{who:9s}{sampling:16s}{function:14s}{index[:5]:9s}"
                    + "".join(f"{error:8.4f}" for error in errors)
                    + f"{slope:8.2f}"
                )
