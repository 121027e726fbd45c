"""How right the indices are, how honest their intervals, and how fast they stream.

`make bench-analysis`, or `python -m benchmarks.analysis [SEEDS]`; 300 seeds take some 20 minutes
of two idle cores.
"""

import sys
import time

import numpy as np

from analysis.estimators import SaltelliEstimator
from analysis.records import LoggedResult, StudyPlan
from analysis.study_state import StudyState
from benchmarks.coverage import print_coverage_and_errors
from benchmarks.functions import FACTORS
from benchmarks.machine import describe_machine


def print_speed(rows: int = 1_000_000, batch: int = 2000) -> None:
    """Print how fast rows of 8 evaluations stream, and how long a snapshot takes.

    In processor time, all threads together, which other work on the machine does not stretch.
    """
    rng = np.random.default_rng(1)
    estimator = SaltelliEstimator(sampling="sobol_blocks", seed=1, factors=FACTORS, outputs=1)
    values = rng.normal(size=(batch, FACTORS + 2, 1))
    started = time.process_time()
    for start in range(0, rows, batch):
        estimator.add_rows(range(start, start + batch), values)
    seconds = time.process_time() - started
    size = len(estimator.to_bytes())
    rate = rows * estimator.width / seconds
    print(f"\n{rows:,} rows of {estimator.width} evaluations, 200 replicates, one output:")
    print(f"  {rate:,.0f} evaluations per second of processor time,")
    print(f"  state {size / 1e6:.1f} MB whatever the number of rows")
    plan = StudyPlan(
        id="s",
        method="saltelli",
        seed=1,
        sampling="sobol_blocks",
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
    started = time.process_time()
    state.take(results)
    rate = len(results) / (time.process_time() - started)
    started = time.process_time()
    state.snapshot()
    snapshot = time.process_time() - started
    started = time.process_time()
    size = len(state.to_bytes())
    saved = time.process_time() - started
    print("A study of 512 rows of 8 evaluations with 12 outputs, as the analysis process keeps it:")
    print(
        f"  {rate:,.0f} results/s; a snapshot takes {1e3 * snapshot:.0f} ms, its state "
        f"({size / 1e6:.1f} MB) {1e3 * saved:.0f} ms, of processor time"
    )


def main() -> None:
    """Print all tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    print(describe_machine())
    print_coverage_and_errors(seeds)
    print_speed()


if __name__ == "__main__":
    main()
