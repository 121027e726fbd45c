"""Tables of Markdown of what `coverage` beside this finds: honesty and width of intervals, errors.

Of 10 000 seeds an exactly honest interval at 90 % holds the truth in 0.894 to 0.906 of 19 cells in
20 (binomial error 0.003), of 1000 seeds in 0.88 to 0.92 (0.0095), of 300 in 0.87 to 0.93 of nine in
ten (0.017).
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from analysis.designs import DEFAULT_SAMPLING, SAMPLINGS
from analysis.sensitivity.remarks import FEWEST_ROWS
from benchmarks.sensitivity.coverage import (
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
from tests.testbed.functions.scalar import KNOWN

HONEST = (0.87, 0.93)
SYMBOLS = {"first_order": "S", "total_order": "ST", "mu": "mu", "mu_star": "mu*", "sigma": "sigma"}
#: An index or effect below this is that of an idle factor, which is exactly 0.
IDLE = 1e-6


def print_coverage_and_errors(seeds: int, all_designs: int, with_rivals: int) -> None:
    """Print coverage of 90 % intervals, and errors with the slope of their fall.

    Args:
        seeds: how many, for the default base points.
        all_designs: how many of them, the first ones, the other base points get too.
        with_rivals: how many of those SALib, SciPy and screening get too.
    """
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    samplings = [SAMPLINGS if i < all_designs else (DEFAULT_SAMPLING,) for i in range(seeds)]
    asked = [i < with_rivals for i in range(seeds)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        effects = pool.submit(true_effects)
        every = list(pool.map(one_seed, numbers, samplings, asked, chunksize=4))
        screening = stacked(list(pool.map(screened, numbers[:with_rivals], chunksize=4)))
        of_effects = effects.result()
    found, truth = stacked(every), truths()
    print(f"\nShare of {LEVEL:.0%} intervals that hold the truth: mean over the functions and the")
    print("factors that matter (their range), share of these cells within 0.87 to 0.93.")
    print("'u1 > 0.8': truth of the range that succeeds, in brackets of the whole range, which is")
    print("not promised. Half width: median, without failures.")
    print(
        f"Seeds from {numbers[0]} on: {seeds} for `{DEFAULT_SAMPLING}`, {all_designs} for others,"
    )
    print(f"{with_rivals} where other programs are shown too.")
    for who in ("rehyb", "Martinez"):
        head(who, FAILURES)
        for key in found:
            if key[0] == who:
                print_lines(key, found[key], truth, INDICES)
    head(f"The first {with_rivals} seeds, all on the same samples", FAILURES[:1])
    for sampling in SHARED:
        for rows in SIZES:
            for who in ("rehyb", "SALib", "SciPy"):
                first = found[who, sampling, rows][:with_rivals, :, :, :1]
                print_lines((who, sampling, rows), first, truth[:, :1], INDICES)
    head("Elementary effects", FAILURES[:1])
    for key, estimates in screening.items():
        print_lines(key, estimates, of_effects, EFFECTS)
    ours = {key: share for key, share in found.items() if key[0] == "rehyb"}
    print_functions(ours, truth)
    print_few_rows(found, truth)
    print_errors({key: one for key, one in found.items() if key[0] != "rests on"}, truth)


def head(title: str, kinds: Sequence[str]) -> None:
    """Print a title and the head of a table of `print_lines`."""
    print(f"\n{title}\n")
    row("Who", "Base points", "N", "Index", "Half width", *kinds)
    row(*["---"] * (5 + len(kinds)))


def row(*cells: object) -> None:
    """Print a line of a table."""
    print("| " + " | ".join(map(str, cells)) + " |")


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
        cells = [described(share[k][active[k]]) for k in range(kinds)]
        if kinds > 2:
            whole = coverage(estimates[:, :, i, 2], truth[i, 0])
            cells[2] += f" [{whole[active[0]].mean():.2f}]"
        widths = (estimates[:, 2, i, 0] - estimates[:, 1, i, 0])[:, active[0]]
        half = 0.5 * np.nanmedian(widths, axis=0).mean()
        row(who, f"`{sampling}`", rows, SYMBOLS[name], f"{half:.4f}", *cells)


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
    """Return the mean, the range and how much is within `HONEST`."""
    honest = np.mean((share >= HONEST[0] - 1e-9) & (share <= HONEST[1] + 1e-9))
    return f"{share.mean():.3f} ({share.min():.3f} to {share.max():.3f}) {honest:4.0%}"


def print_functions(found: Mapping[tuple[str, str, int], Array], truth: Array) -> None:
    """Print coverage by function: mean over its factors that matter (worst factor)."""
    active = truth[1] > IDLE
    print("\nThe same by function\n")
    row("Base points", "N", "Index", "Failures", *KNOWN)
    row(*["---"] * (4 + len(KNOWN)))
    for (_, sampling, rows), estimates in found.items():
        for i, name in enumerate(INDICES):
            for k, kind in enumerate(FAILURES):
                share = coverage(estimates[:, :, i, k], truth[i, k])
                cells = [share[f][active[k, f]] for f in range(len(KNOWN))]
                means = [f"{cell.mean():.3f} ({cell.min():.2f})" for cell in cells]
                row(f"`{sampling}`", rows, SYMBOLS[name], kind, *means)


def print_few_rows(found: Found, truth: Array) -> None:
    """Print how honest intervals of ST are where a study would say that few rows make it up."""
    print(
        f"\nIntervals of ST that rest on fewer than {FEWEST_ROWS:g} rows, of which remarks warn\n"
    )
    row("Base points", "N", "Share of the indices", "Of which hold the truth")
    row(*["---"] * 4)
    for (who, sampling, rows), behind in found.items():
        if who != "rests on":
            continue
        estimates = found["rehyb", sampling, rows][:, :, 1]
        held = (estimates[:, 1] <= truth[1]) & (truth[1] <= estimates[:, 2])
        few = behind < FEWEST_ROWS
        share = few[:, truth[1] > IDLE].mean()
        row(f"`{sampling}`", rows, f"{share:.2%}", f"{held[few].mean():.2f}" if few.any() else "–")


def print_errors(found: Found, truth: Array) -> None:
    """Print root mean square errors without failures, and the power of N that they follow."""
    active = truth[1, 0] > IDLE
    print("\nRoot mean square error, mean over the factors that matter, without failures, and the")
    print("power of N that it follows. SciPy's values are ours, and so is SALib's ST.\n")
    row("Function", "Index", "Who", "Base points", *(f"N = {n}" for n in SIZES), "slope")
    row(*["---"] * (5 + len(SIZES)))
    for f, function in enumerate(KNOWN):
        for i, index in enumerate(INDICES):
            for who, sampling in dict.fromkeys((who, sampling) for who, sampling, _ in found):
                if who == "SciPy" or (who == "SALib" and index == "total_order"):
                    continue
                off = [found[who, sampling, n][:, 0, i, 0, f] - truth[i, 0, f] for n in SIZES]
                errors = [np.sqrt(np.mean(one**2, axis=0))[active[f]].mean() for one in off]
                slope = np.polyfit(np.log(SIZES), np.log(errors), 1)[0]
                cells = [f"{error:.4f}" for error in errors]
                row(function, SYMBOLS[index], who, f"`{sampling}`", *cells, f"{slope:.2f}")
