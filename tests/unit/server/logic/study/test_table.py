"""Results as a table."""

from collections.abc import Callable

from server.logic.study.points import parameters
from server.logic.study.table import lines
from server.records import Plan, Result


def result(row: int, position: int, outcome: str, y: float | None) -> Result:
    return Result(
        row=row,
        position=position,
        outcome=outcome,
        outputs=None if y is None else {"y": y},
        reason="",
        state=None,
        wall_seconds=0.5 if y else None,
    )


def test_a_line_holds_place_point_outcome_outputs_time_and_worker(
    plan: Callable[..., Plan],
) -> None:
    drawn = plan()
    results = [result(0, 1, "ok", 2.0), result(0, 3, "lost", None), result(1, 0, "ok", 3.0)]
    table = list(lines(drawn, zip(results, ["a", "b", "c"], strict=True)))
    points = [parameters(drawn, row)[position] for row, position in ((0, 1), (0, 3), (1, 0))]
    assert table == [
        [0, 1, *points[0].values(), "ok", 2.0, 0.5, "a"],
        [0, 3, *points[1].values(), "lost", None, None, "b"],
        [1, 0, *points[2].values(), "ok", 3.0, 0.5, "c"],
    ]
    assert list(points[0]) == list(drawn.distributions)


def test_a_table_may_begin_with_any_row(plan: Callable[..., Plan]) -> None:
    drawn = plan()
    (line,) = lines(drawn, [(result(1, 2, "ok", 2.0), "a")])
    assert line == [1, 2, *parameters(drawn, 1)[2].values(), "ok", 2.0, 0.5, "a"]
