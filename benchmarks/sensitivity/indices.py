"""How right the indices are, how honest their intervals, and how fast they stream.

`make bench-analysis`, or `python -m benchmarks.sensitivity.indices [SEEDS] [ALL DESIGNS] [RIVALS]`:
10 000 seeds for the default base points, of which the other base points get 1000, SALib and SciPy
300, take a quarter of an hour of two idle cores. OpenBLAS must have one thread (the target says
so): several processes with several threads each wait for each other.
"""

import sys
import time

import numpy as np

from analysis.designs import DEFAULT_SAMPLING
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.estimators import SaltelliEstimator
from benchmarks.machine import describe_machine
from benchmarks.sensitivity.coverage_tables import print_coverage_and_errors
from benchmarks.sensitivity.latency import PLAN, lags, results
from tests.testbed.functions.scalar import FACTORS


def print_speed(rows: int = 1_000_000) -> None:
    """Print how fast rows of 8 evaluations go in, in one batch after another and one by one.

    In processor time, all threads together, which other work on the machine does not stretch.
    """
    print(f"\nRows of {FACTORS + 2} evaluations, 200 replicates, one output:")
    for batch, number in ((2000, rows), (100, rows // 10), (1, rows // 500)):
        values = np.random.default_rng(1).normal(size=(batch, FACTORS + 2, 1))
        estimator = SaltelliEstimator(sampling=DEFAULT_SAMPLING, seed=1, factors=FACTORS, outputs=1)
        started = time.process_time()
        for start in range(0, number, batch):
            estimator.add_rows(range(start, start + batch), values)
        rate = number * estimator.width / (time.process_time() - started)
        size = len(estimator.to_bytes())
        print(
            f"  {number:9,} rows, {batch:4d} at a time: {rate:9,.0f} evaluations per second of "
            f"processor time, state {size / 1e6:.2f} MB"
        )


def print_latency() -> None:
    """Print what a study of 12 outputs costs the analysis, and how far its indices lag behind."""
    arrived = results(512 * 8)
    state = EstimatorState(PLAN)
    started = time.process_time()
    state.take(arrived)
    rate = len(arrived) / (time.process_time() - started)
    started = time.process_time()
    state.snapshot()
    snapshot = time.process_time() - started
    started = time.process_time()
    size = len(state.to_bytes())
    saved = time.process_time() - started
    print(
        "\nA study of 512 rows of 8 evaluations with 12 outputs, as the analysis process keeps it:"
    )
    print(
        f"  {rate:,.0f} results/s; a snapshot takes {1e3 * snapshot:.0f} ms, its state "
        f"({size / 1e6:.1f} MB) {1e3 * saved:.0f} ms, of processor time"
    )
    waited = lags()
    print(
        f"  at 500 results/s the oldest result of a commit waited {max(waited):.2f} s at most, "
        f"{np.median(waited):.2f} s in the median of {len(waited)} commits (wall clock)"
    )


def main() -> None:
    """Print all tables."""
    asked = [int(one) for one in sys.argv[1:]]
    seeds, all_designs, with_rivals = asked + [10_000, 1000, 300][len(asked) :]
    print(describe_machine())
    print_speed()
    print_latency()
    sys.stdout.flush()
    print_coverage_and_errors(seeds, min(seeds, all_designs), min(seeds, all_designs, with_rivals))


if __name__ == "__main__":
    main()
