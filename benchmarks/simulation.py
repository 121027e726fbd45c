"""What an assessment costs, how far it can be believed, and how the fidelities agree.

`python -m benchmarks.simulation [POINTS]`: POINTS Sobol points of Table 1 (default 512).
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
from sim.assessment import Assessment, assess
from sim.factors import NOMINAL, TABLE_1
from sim.fidelity import CAMPAIGN, FIDELITIES, Fidelity

SEED = 3
#: Points on which the fidelities are compared with `reference`.
COMPARED = 64
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


def run_nominal(_: int) -> float:
    """Return the seconds of one nominal assessment."""
    started = time.perf_counter()
    assess({})
    return time.perf_counter() - started


def summary(assessment: Assessment) -> tuple[str, list[float]]:
    return assessment.outcome, [assessment.outputs.get(name, np.nan) for name in QUANTITIES]


def print_speed() -> None:
    print("\nSeconds per assessment, one process (median of 20, nominal wearer)")
    for fidelity in ("bushing", *FIDELITIES):
        assess({}, fidelity=fidelity)
        seconds = []
        for _ in range(20):
            started = time.perf_counter()
            assess({}, fidelity=fidelity)
            seconds.append(time.perf_counter() - started)
        print(f"  {fidelity:10s} {np.median(seconds):.3f}")
    for processes in (1, 2):
        with get_context("spawn").Pool(processes) as pool:
            pool.map(run_nominal, range(processes))
            started = time.perf_counter()
            pool.map(run_nominal, range(20 * processes), chunksize=1)
            rate = 20 * processes / (time.perf_counter() - started)
        print(f"  {processes} processes at campaign: {rate:.2f} assessments/s")


def run_all(jobs: Sequence[Job]) -> tuple[list[str], np.ndarray]:
    """Run jobs on two processes; return outcomes and stiffnesses, shape (n, 3)."""
    with get_context("spawn").Pool(2) as pool:
        results = pool.map(run, jobs, chunksize=1)
    return [outcome for outcome, _ in results], np.array([values for _, values in results])


def print_outcomes(title: str, outcomes: Sequence[str], stiffness: np.ndarray) -> None:
    print(f"\n{title}")
    for outcome, count in Counter(outcomes).most_common():
        print(f"  {outcome:18s} {count:4d}  {count / len(outcomes):.1%}")
    for i, name in enumerate(QUANTITIES):
        column = stiffness[:, i][np.isfinite(stiffness[:, i])]
        print(
            f"  {name:18s} mean {column.mean():6.2f}  sd {column.std(ddof=1):5.2f}  "
            f"{column.min():6.2f} to {column.max():6.2f} Nm/rad"
        )


def print_agreement(points: np.ndarray) -> None:
    print(f"\nAgreement with `reference` on {len(points)} Sobol points")
    print("  fidelity    estimate: rank corr.  rms   bias     error: rank corr.  rms   bias")
    reference = run_all([(tuple(point), "reference") for point in points])[1]
    for fidelity in ("campaign", "screening", "bushing"):
        other = run_all([(tuple(point), fidelity) for point in points])[1]
        both = np.isfinite(reference).all(axis=1) & np.isfinite(other).all(axis=1)
        cells = []
        for i in (0, 2):
            difference = other[both, i] - reference[both, i]
            rank = spearmanr(other[both, i], reference[both, i])[0]
            cells.append(
                f"{rank:16.4f} {np.sqrt(np.mean(difference**2)):7.3f} {difference.mean():6.3f}"
            )
        print(f"  {fidelity:10s} {cells[0]}  {cells[1]}   ({both.sum()} points)")


def print_noise(sd: float) -> None:
    print("\nNoise: sd of stiffness_error under relative perturbations of 1e-9 to 1e-5")
    worst = 0.0
    points = qmc.Sobol(len(TABLE_1), rng=np.random.default_rng(SEED)).random(4)
    for values in (dict(NOMINAL), *(values_of(point) for point in points)):
        errors = []
        for power in range(-9, -4):
            for sign in (-1.0, 1.0):
                moved = {name: x * (1.0 + sign * 10.0**power) for name, x in values.items()}
                errors.append(assess(moved).outputs["stiffness_error"])
        worst = max(worst, float(np.std(errors, ddof=1)))
    print(f"  worst of 5 wearers {worst:.5f} Nm/rad, {worst / sd:.2%} of the sd over Table 1")


def print_convergence(points: np.ndarray) -> None:
    print(f"\nConvergence: rms change of stiffness_error against `campaign`, {len(points)} points")
    base = run_all([(tuple(point), CAMPAIGN) for point in points])[1][:, 2]
    for label, variant in (
        ("rings 12 -> 8", replace(CAMPAIGN, rings=8)),
        ("rings 12 -> 16", replace(CAMPAIGN, rings=16)),
        ("around 8 -> 12", replace(CAMPAIGN, per_ring=12)),
        ("strap 6 x 2 -> 8 x 3", replace(CAMPAIGN, strap_across=8, strap_rows=3)),
        ("step 12.5 -> 5 ms", replace(CAMPAIGN, step=0.005)),
        ("friction creeps -> holds", replace(CAMPAIGN, impratio=20.0)),
    ):
        other = run_all([(tuple(point), variant) for point in points])[1][:, 2]
        difference = other - base
        print(
            f"  {label:22s} rms {np.sqrt(np.nanmean(difference**2)):.3f}  "
            f"mean {np.nanmean(difference):6.3f} Nm/rad"
        )


def main(points: int) -> None:
    print(describe_machine())
    print_speed()
    unit = qmc.Sobol(len(TABLE_1), rng=np.random.default_rng(SEED)).random(max(points, COMPARED))
    outcomes, stiffness = run_all([(tuple(point), CAMPAIGN) for point in unit[:points]])
    print_outcomes(f"{points} Sobol points of Table 1 at campaign", outcomes, stiffness)
    corners = list(product((0.0, 1.0), repeat=len(TABLE_1)))
    print_outcomes(
        "The 64 corners of Table 1 at campaign", *run_all([(c, CAMPAIGN) for c in corners])
    )
    print_noise(float(np.nanstd(stiffness[:, 2], ddof=1)))
    print_agreement(unit[:COMPARED])
    print_convergence(unit[: COMPARED // 4])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 512)
