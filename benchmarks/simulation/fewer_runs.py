"""The paper's study by a fitted function: how many assessments ±0.02 on every S and ST needs.

`python -m benchmarks.simulation.fewer_runs MODEL [ROWS [SEED]]`: the six factors of Table 1, as a
study of method surrogate of MODEL (`elbow` with contact, `elbow_bushing` without) at 128, 256 and
512 assessments, until every output is within ±0.02 and believed, or the study gives up. Beside it
stand the intervals of ROWS rows of method saltelli of another seed (default 512; 0: none).
"""

import sys
from collections.abc import Iterator, Sequence
from typing import Any

from analysis.designs import DEFAULT_SAMPLING, instance_parameters
from analysis.designs.distributions import Uniform
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.fewer_runs.limits import LOOKS
from analysis.sensitivity.judgement.stopping import SHARE_TARGET, Goal, next_step
from analysis.sensitivity.records import LoggedResult, StudyPlan
from benchmarks.machine import describe_machine
from sim.evaluation import evaluate
from sim.models import MODELS

OUTPUTS = (
    "stiffness_error",
    "stiffness_error_authors",
    "stiffness_estimate",
    "stiffness_true",
)


def factors(model: str) -> dict[str, Uniform]:
    """Return the factors of Table 1 with their ranges."""
    return {
        factor.name: Uniform(low=factor.low, high=factor.high)
        for factor in MODELS[model].factors
        if not factor.optional
    }


def plan_of(model: str, method: str, rows: int, seed: int) -> StudyPlan:
    """Return a study of one method."""
    return StudyPlan(
        id=method,
        method=method,
        seed=seed,
        sampling=DEFAULT_SAMPLING,
        rows=rows,
        factors=tuple(factors(model)),
        outputs=OUTPUTS,
    )


def assessed(plan: StudyPlan, model: str, rows: Sequence[int]) -> Iterator[LoggedResult]:
    """Yield the assessments of some rows."""
    for row in rows:
        points = instance_parameters(plan.method, plan.sampling, plan.seed, row, factors(model))
        for position, point in enumerate(points):
            found = evaluate(model, point)
            yield LoggedResult(
                seq=row * len(points) + position + 1,
                instance=f"{plan.id}:{row}:{position}",
                row=row,
                position=position,
                outcome=found.outcome,
                outputs={o: found.outputs[o] for o in OUTPUTS} if found.outcome == "ok" else {},
            )


def fitted(model: str, seed: int) -> dict[str, Any]:
    """Return the last snapshot of a study that stops by itself; print what it says at each look."""
    state = EstimatorState(plan_of(model, "surrogate", LOOKS[-1], seed))
    start = 0
    for rows in LOOKS:
        state.take(assessed(state.plan, model, range(start, rows)))
        start = rows
        snapshot = state.snapshot()
        print(f"\n{rows} assessments, failed: {snapshot['failure']['failed']}")
        goals = [Goal(output=output, target=SHARE_TARGET, up_to=LOOKS[-1]) for output in OUTPUTS]
        steps = [next_step(snapshot, goal, rows) for goal in goals]
        for output, step in zip(OUTPUTS, steps, strict=True):
            assert step is not None
            print(f"  {output}: {'reached' if step.reached else 'not reached'}. {step.sentence}")
        if all(step is not None and step.rows is None for step in steps):
            break
    return snapshot


def beside(one: dict[str, Any], other: dict[str, Any] | None) -> None:
    """Print the indices of two studies, and how many intervals of both overlap."""
    common = total = 0
    for output in OUTPUTS:
        print(f"\n{output}")
        for factor, found in one["outputs"][output]["factors"].items():
            cells = []
            for index in ("first_order", "total_order"):
                mine = found[index]
                cells.append(f"{mine['value']:.3f} [{mine['low']:.3f}, {mine['high']:.3f}]")
                if other is not None:
                    theirs = other["outputs"][output]["factors"][factor][index]
                    cells.append(f"[{theirs['low']:.3f}, {theirs['high']:.3f}]")
                    total += 1
                    common += mine["low"] <= theirs["high"] and theirs["low"] <= mine["high"]
            print(f"  {factor:22s} " + "  ".join(cells))
    if other is not None:
        print(f"\n{common} of {total} pairs of intervals overlap")


def main(model: str, rows: str = "512", seed: str = "1000") -> None:
    print(describe_machine())
    found = fitted(model, int(seed))
    sampled = None
    if int(rows):
        plan = plan_of(model, "saltelli", int(rows), int(seed) + 1)
        state = EstimatorState(plan)
        state.take(assessed(plan, model, range(int(rows))))
        sampled = state.snapshot()
        print(f"\nbeside {sum(sampled['evaluations'].values())} sampled assessments")
    print("S, that of the sampled study, ST, that of the sampled study:")
    beside(found, sampled)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python -m benchmarks.simulation.fewer_runs MODEL [ROWS [SEED]]")
    main(*sys.argv[1:])
