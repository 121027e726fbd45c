"""What an assessment costs, how far it can be believed, and how the fidelities agree.

`python -m benchmarks.simulation.fidelities [POINTS [MEASURED]]`: POINTS Sobol points of Table 1
(default 512); the time of the paper's study is extrapolated from MEASURED assessments (default
1000).
"""

import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from multiprocessing import get_context

import numpy as np
from scipy.stats import qmc, spearmanr

from benchmarks.machine import describe_machine
from benchmarks.measuring import Target, say
from benchmarks.simulation.batched import print_rates
from sim.assessment.assess import Assessment, assess
from sim.parameters.fidelity import CAMPAIGN, FIDELITIES, Fidelity
from sim.parameters.wearer import NOMINAL, TABLE_1

SEED = 3
#: Points on which the fidelities are compared with `reference`.
COMPARED = 64
#: Wearers whose numerical noise is looked at, the nominal one among them.
NOISY = 9
#: Assessments of the paper's study: r = 150 of six factors, then N = 3000 of five.
PAPER = 150 * 7 + 3000 * 7
QUANTITIES = ("stiffness_estimate", "stiffness_true", "stiffness_error")
LOW = np.array([factor.low for factor in TABLE_1])
HIGH = np.array([factor.high for factor in TABLE_1])
Job = tuple[tuple[float, ...], str | Fidelity]


def values_of(unit: Sequence[float]) -> dict[str, float]:
    """Return the wearer at a point of the unit cube over Table 1."""
    point = LOW + np.asarray(unit) * (HIGH - LOW)
    return {factor.name: float(x) for factor, x in zip(TABLE_1, point, strict=True)}


def run(job: Job) -> tuple[str, list[float]]:
    """Return outcome and the three stiffnesses of one point at one fidelity."""
    unit, fidelity = job
    return summary(assess(values_of(unit), fidelity=fidelity))


def summary(assessment: Assessment) -> tuple[str, list[float]]:
    return assessment.outcome, [assessment.outputs.get(name, np.nan) for name in QUANTITIES]


def print_speed() -> dict[str, float]:
    """Print and return the seconds of one assessment by fidelity."""
    print("\nSeconds per assessment, one process (median of 20, nominal wearer)")
    medians = {}
    for fidelity in FIDELITIES:
        assess({}, fidelity=fidelity)
        seconds = []
        for _ in range(20):
            started = time.perf_counter()
            assess({}, fidelity=fidelity)
            seconds.append(time.perf_counter() - started)
        medians[fidelity] = float(np.median(seconds))
        print(f"  {fidelity:10s} {medians[fidelity]:.4f}", flush=True)
    return medians


def run_all(jobs: Sequence[Job], what: str) -> tuple[list[str], np.ndarray]:
    """Run jobs on two processes; return outcomes and stiffnesses, shape (n, 3)."""
    results = []
    with get_context("spawn").Pool(2) as pool:
        for number, result in enumerate(pool.imap(run, jobs), start=1):
            results.append(result)
            if number % 64 == 0 or number == len(jobs):
                say(f"{what}: {number} of {len(jobs)}")
    return [outcome for outcome, _ in results], np.array([values for _, values in results])


def print_outcomes(title: str, outcomes: Sequence[str], stiffness: np.ndarray) -> float:
    """Print how assessments ended and what they found; return the share that was ok."""
    print(f"\n{title}")
    for outcome, count in Counter(outcomes).most_common():
        print(f"  {outcome:18s} {count:4d}  {count / len(outcomes):.1%}")
    for i, name in enumerate(QUANTITIES):
        column = stiffness[:, i][np.isfinite(stiffness[:, i])]
        print(
            f"  {name:18s} mean {column.mean():6.2f}  sd {column.std(ddof=1):5.2f}  "
            f"{column.min():6.2f} to {column.max():6.2f} Nm/rad"
        )
    return outcomes.count("ok") / len(outcomes)


def print_agreement(points: np.ndarray) -> dict[str, tuple[float, float]]:
    """Print and return how each fidelity agrees: least rank correlation, largest rms."""
    print(f"\nAgreement with `reference` on {len(points)} Sobol points")
    print("  fidelity    estimate: rank corr.  rms   bias     error: rank corr.  rms   bias")
    units = [tuple(point) for point in points]
    reference = run_all([(unit, "reference") for unit in units], "reference")[1]
    found = {}
    for fidelity in ("campaign", "screening", "bushing"):
        other = run_all([(unit, fidelity) for unit in units], fidelity)[1]
        both = np.isfinite(reference).all(axis=1) & np.isfinite(other).all(axis=1)
        cells, ranks, sizes = [], [], []
        for i in (0, 2):
            difference = other[both, i] - reference[both, i]
            ranks.append(float(spearmanr(other[both, i], reference[both, i])[0]))
            sizes.append(float(np.sqrt(np.mean(difference**2))))
            cells.append(f"{ranks[-1]:16.4f} {sizes[-1]:7.3f} {difference.mean():6.3f}")
        print(f"  {fidelity:10s} {cells[0]}  {cells[1]}   ({both.sum()} points)", flush=True)
        found[fidelity] = min(ranks), max(sizes)
    return found


def print_noise(sd: float) -> float:
    """Print the numerical noise; return its worst share of `sd`."""
    print("\nNoise: sd of stiffness_error under relative perturbations of 1e-9 to 1e-5")
    noise = []
    points = qmc.Sobol(len(TABLE_1), rng=np.random.default_rng(SEED)).random(NOISY - 1)
    for values in (dict(NOMINAL), *(values_of(point) for point in points)):
        errors = []
        for power in range(-9, -4):
            for sign in (-1.0, 1.0):
                moved = {name: x * (1.0 + sign * 10.0**power) for name, x in values.items()}
                errors.append(assess(moved).outputs["stiffness_error"])
        noise.append(float(np.std(errors, ddof=1)))
        say(f"noise: {len(noise)} of {NOISY} wearers")
    print(
        f"  {NOISY} wearers: median {np.median(noise):.5f}, worst {max(noise):.5f} Nm/rad, "
        f"{max(noise) / sd:.2%} of the sd over Table 1"
    )
    return max(noise) / sd


def print_convergence(points: np.ndarray) -> None:
    print(f"\nConvergence: rms change of stiffness_error against `campaign`, {len(points)} points")
    units = [tuple(point) for point in points]
    base = run_all([(unit, CAMPAIGN) for unit in units], "convergence")[1][:, 2]
    for label, variant in (
        ("rings 12 -> 8", replace(CAMPAIGN, rings=8)),
        ("rings 12 -> 16", replace(CAMPAIGN, rings=16)),
        ("around 8 -> 12", replace(CAMPAIGN, per_ring=12)),
        ("strap 6 x 3 -> 6 x 2", replace(CAMPAIGN, strap_rows=2)),
        ("strap 6 x 3 -> 8 x 3", replace(CAMPAIGN, strap_across=8)),
        ("step 15 -> 5 ms", replace(CAMPAIGN, step=0.005)),
        ("friction creeps -> holds", replace(CAMPAIGN, impratio=20.0)),
        ("onset of contact abrupt", replace(CAMPAIGN, onset=(0.95, 0.002))),
        ("cones -> pyramids", replace(CAMPAIGN, pyramids=True)),
    ):
        other = run_all([(unit, variant) for unit in units], label)[1][:, 2]
        difference = other - base
        print(
            f"  {label:24s} rms {np.sqrt(np.nanmean(difference**2)):.3f}  "
            f"mean {np.nanmean(difference):6.3f} Nm/rad",
            flush=True,
        )


def main(points: int, measured: int) -> None:
    print(describe_machine())
    seconds = print_speed()
    print_rates()
    rows = max(points, measured, COMPARED)
    sobol = qmc.Sobol(len(TABLE_1), rng=np.random.default_rng(SEED))
    unit = sobol.random_base2((rows - 1).bit_length())
    run_all([(tuple(point), CAMPAIGN) for point in unit[:2]], "warming up")
    started = time.perf_counter()
    results = run_all([(tuple(point), CAMPAIGN) for point in unit[:measured]], "Table 1")
    study = (time.perf_counter() - started) * PAPER / measured / 60.0
    if measured < points:
        results = run_all([(tuple(point), CAMPAIGN) for point in unit[:points]], "Table 1")
    outcomes, stiffness = results[0][:points], results[1][:points]
    ok = print_outcomes(f"{points} Sobol points of Table 1 at campaign", outcomes, stiffness)
    print(
        f"\nThe paper's {PAPER} assessments on two processes: {study:.0f} minutes "
        f"(extrapolated from {measured})"
    )
    corners = run_all([(c, CAMPAIGN) for c in product((0.0, 1.0), repeat=len(TABLE_1))], "corners")
    held = print_outcomes("The 64 corners of Table 1 at campaign", *corners)
    noise = print_noise(float(np.nanstd(stiffness[:, 2], ddof=1)))
    agreed = print_agreement(unit[:COMPARED])
    print_convergence(unit[: COMPARED // 4])
    print("\nTargets")
    for what, figure, bound, unit_, at_least in (
        ("one assessment at campaign", 1e3 * seconds["campaign"], 120.0, "ms", False),
        ("one assessment at bushing", 1e3 * seconds["bushing"], 12.0, "ms", False),
        (f"{points} points that are ok", 100.0 * ok, 99.5, "%", True),
        ("corners that are ok", 100.0 * held, 100.0, "%", True),
        ("noise over sd, in thousandths", 1e3 * noise, 1.5, "", False),
        *(
            target
            for fidelity, rank, rms in (("campaign", 0.99, 0.1), ("bushing", 0.98, 0.15))
            for target in (
                (
                    f"{fidelity}: rank correlation, 1/1000",
                    1e3 * agreed[fidelity][0],
                    1e3 * rank,
                    "",
                    True,
                ),
                (
                    f"{fidelity}: rms from reference",
                    1e3 * agreed[fidelity][1],
                    1e3 * rms,
                    "mNm/rad",
                    False,
                ),
            )
        ),
        ("the paper's study", study, 60.0, "minutes", False),
    ):
        target = Target(what=what, figure=figure, bound=bound, unit=unit_, at_least=at_least)
        print(target.line())


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:]]
    main(numbers[0] if numbers else 512, numbers[1] if len(numbers) > 1 else 1000)
