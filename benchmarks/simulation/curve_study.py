"""The paper's study with curves: what moves torque, angle error and contact force, and when.

`python -m benchmarks.simulation.curve_study [ROWS] [FOLDER]`: Table 1's factors, bushings instead
of contact, 512 rows, in this process; with a folder, two figures of each curve go into it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from analysis.designs import DEFAULT_SAMPLING, instance_parameters
from analysis.designs.distributions import Uniform
from analysis.reports.figures import components, curve
from analysis.reports.paper import on_paper
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from benchmarks.machine import describe_machine
from models.curves import columns_of
from sim.evaluation import evaluate
from sim.parameters.curves import OVER_PHASE, UNITS
from sim.parameters.wearer import TABLE_1

MODEL = "elbow_bushing"
ROWS = 512
#: Where along the phase indices are printed: start, middle, end.
PLACES = (10, 50, 90)


def study(rows: int) -> StudyPlan:
    """Return the study of all three curves and the error of the stiffness."""
    return StudyPlan(
        id="curves",
        method="saltelli",
        seed=1,
        sampling=DEFAULT_SAMPLING,
        rows=rows,
        factors=tuple(factor.name for factor in TABLE_1),
        outputs=("stiffness_error", *columns_of(OVER_PHASE, OVER_PHASE)),
        curves=OVER_PHASE,
    )


def results(plan: StudyPlan) -> Iterator[LoggedResult]:
    """Evaluate every instance of the study."""
    ranges = {factor.name: Uniform(low=factor.low, high=factor.high) for factor in TABLE_1}
    seq = 0
    for row in range(plan.rows):
        points = instance_parameters(plan.method, plan.sampling, plan.seed, row, ranges)
        for position, point in enumerate(points):
            done = evaluate(MODEL, point, tuple(OVER_PHASE))
            seq += 1
            yield LoggedResult(
                seq=seq,
                instance=f"{row}:{position}",
                row=row,
                position=position,
                outcome=done.outcome,
                outputs={name: done.outputs[name] for name in plan.outputs} if done.outputs else {},
            )


def print_curve(name: str, said: dict[str, Any]) -> None:
    """Print a curve's generalised indices, those at three places, and of its components."""
    whole = said["whole"]["factors"]
    print(f"\n`{name}` ({UNITS[name]})\n")
    places = " | ".join(f"ST at {place} %" for place in PLACES)
    scores = [f"{one['share']['value']:.1%}" for one in said["components"]]
    heads = " | ".join(f"ST of component {c + 1} ({share})" for c, share in enumerate(scores))
    print(f"| Factor | S, whole curve | ST, whole curve | interaction | {places} | {heads} |")
    print(f"|{'---|' * (4 + len(PLACES) + len(scores))}")
    for factor in said["ranking"]["order"]:
        cells = [_cell(whole[factor][i]) for i in ("first_order", "total_order", "interaction")]
        total = said["factors"][factor]["total_order"]
        cells += [
            f"{total['value'][p]:.2f} [{total['band_low'][p]:.2f}, {total['band_high'][p]:.2f}]"
            for p in PLACES
        ]
        cells += [_cell(one["factors"][factor]["total_order"]) for one in said["components"]]
        print(f"| {factor} | {' | '.join(cells)} |")


def _cell(index: dict[str, float]) -> str:
    return f"{index['value']:.2f} [{index['low']:.2f}, {index['high']:.2f}]"


def main() -> None:
    """Print all tables."""
    asked = sys.argv[1:]
    plan = study(int(asked[0]) if asked else ROWS)
    snapshot = analyse(plan, results(plan))
    print(describe_machine())
    print(f"\n{plan.rows} rows, {sum(snapshot['evaluations'].values()):,} assessments:", end=" ")
    print(", ".join(f"{count:,} {name}" for name, count in snapshot["evaluations"].items()))
    for name, said in snapshot["curves"].items():
        print_curve(name, said)
        if len(asked) > 1:
            folder = Path(asked[1])
            folder.mkdir(parents=True, exist_ok=True)
            on_paper(curve(snapshot, name, UNITS[name])).savefig(folder / f"{name}.png")
            on_paper(components(snapshot, name, UNITS[name])).savefig(folder / f"{name}_parts.png")


if __name__ == "__main__":
    main()
