"""Results as a table, one line per instance."""

from collections.abc import Iterable, Iterator, Sequence

from server.logic.study.points import parameters
from server.records import Plan, Result


def lines(plan: Plan, results: Iterable[tuple[Result, str]]) -> Iterator[Sequence[object]]:
    """Yield a line per result, in the order of `results_csv.columns`; what there is not is None.

    Results of one row stand next to each other, each with its worker.
    """
    row, points = -1, list[dict[str, float]]()
    for result, worker in results:
        if result.row != row:
            row, points = result.row, parameters(plan, result.row)
        point, outputs = points[result.position], result.outputs or {}
        yield [
            result.row,
            result.position,
            *(point[factor] for factor in plan.distributions),
            result.outcome,
            *(outputs.get(name) for name in plan.outputs),
            result.wall_seconds,
            worker,
        ]
