"""What the coordinator makes of posted curves."""

from collections.abc import Callable
from math import nan

import pytest

from models.curves import Curve
from server.logic.fleet.verdicts import Judgement, Report, fault_in, judge
from server.records import Instance, Lease

Reporting = Callable[..., Report]

MINE = Lease(
    id="mine", fence=1, worker="w", study="s", state="open", expires_at=9.0, instances=((0, 2),)
)

HELD = Instance(row=0, position=2, state="leased", lease="mine", attempts={})

CURVE = {"torque": Curve(points=3, over="phase")}

COLUMNS = ["y", "torque[0]", "torque[1]", "torque[2]"]


def judged_curve(report: Report) -> Judgement:
    return judge(report, instance=HELD, stored=None, lease=MINE, outputs=COLUMNS, curves=CURVE)


def test_a_curve_comes_as_a_list_and_is_kept_point_by_point(report: Reporting) -> None:
    judgement = judged_curve(report("i", outputs={"y": 1, "torque": [1, 2.5, -3]}))
    assert judgement.result is not None
    assert judgement.result.outputs == dict(zip(COLUMNS, [1.0, 1.0, 2.5, -3.0], strict=True))


@pytest.mark.parametrize(
    ("torque", "sentence"),
    [
        ([1.0, 2.0], "output torque must have 3 points, not 2"),
        ([], "output torque must have 3 points, not 0"),
        (1.0, "output torque must be a list of 3 numbers"),
        ([1.0, nan, 3.0], "output torque[1] must be a finite number"),
        ([1.0, None, 3.0], "output torque[1] must be a finite number"),
        ([1.0, [2.0], 3.0], "output torque[1] must be a finite number"),
    ],
)
def test_a_curve_that_is_none_is_one_sentence(
    torque: object, sentence: str, report: Reporting
) -> None:
    assert judged_curve(report("i", outputs={"y": 1.0, "torque": torque})).detail == sentence


def test_a_curve_that_is_missing_or_comes_point_by_point_is_one_sentence(
    report: Reporting,
) -> None:
    by_point = dict.fromkeys(COLUMNS, 1.0)
    for outputs in ({"y": 1.0}, by_point):
        assert judged_curve(report("i", outputs=outputs)).detail == "output torque is missing"


def test_a_failure_has_no_curves(report: Reporting) -> None:
    judgement = judged_curve(report("i", outcome="diverged", outputs={"torque": [1.0]}))
    assert judgement.result is not None and judgement.result.outputs is None
    assert fault_in(report("i"), ["y"]) is None
