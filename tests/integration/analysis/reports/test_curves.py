"""Reports of studies with curves: figures along the axis, whole curves in tables, curves alone."""

from pathlib import Path
from typing import Any

import pytest

from analysis.designs import instance_parameters
from analysis.designs.distributions import Uniform
from analysis.reports.figures import components, curve, interactions
from analysis.reports.paper import on_paper
from analysis.reports.report import chapter, write_report
from analysis.sensitivity.records import plan_of
from analysis.sensitivity.service import analyse
from models.curves import Curve, columns

pytestmark = pytest.mark.usefixtures("without_layout")

UNIT = Uniform(low=0.0, high=1.0)
AXIS = Curve(points=4, over="time", unit="s", high=3.0)


def study(method: str, *outputs: str) -> dict[str, Any]:
    return {
        "id": "s",
        "name": "curves",
        "model": "two",
        "method": method,
        "sampling": "owen_blocks",
        "seed": 1,
        "rows": 16,
        "factors": [{"name": name, "distribution": UNIT.to_json()} for name in "abc"],
        "fixed": {},
        "outputs": list(outputs),
        "curves": {"wave": AXIS.as_json()},
    }


def table_of(described: dict[str, Any], path: Path) -> Path:
    """Write the study's `results.csv`."""
    plan = plan_of(described)
    lines = [["row", "position", *plan.factors, "outcome", *plan.outputs]]
    for row in range(plan.rows):
        points = instance_parameters(
            plan.method,
            plan.sampling,
            plan.seed,
            row,
            dict.fromkeys(plan.factors, UNIT),
            groups=plan.groups,
        )
        for position, point in enumerate(points):
            curve = [point["a"] * i + point["b"] * point["c"] for i in range(4)]
            values = dict(zip(columns("wave", 4), curve, strict=True)) | {"y": point["b"]}
            numbers = [values[name] for name in plan.outputs]
            lines.append([row, position, *point.values(), "ok", *numbers])
    path.write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    return path


@pytest.mark.parametrize("method", ["morris", "saltelli_second_order"])
def test_a_report_shows_curves_beside_the_output_and_alone(method: str, tmp_path: Path) -> None:
    for outputs, shown in ((("y", "wave"), "y"), (("y", "wave"), "wave"), (("wave",), "wave")):
        described = study(method, *outputs)
        one = chapter(described, table_of(described, tmp_path / "r.csv"))
        page, *figures = write_report(
            tmp_path / "r.html", [one], shown, {"wave": "N"}, title="t", folders={"png": tmp_path}
        )
        names = [path.name for path in figures]
        assert [f"1-{method}-wave-{what}.png" in names for what in ("indices", "components")] == [
            True,
            True,
        ]
        text = page.read_text()
        assert "Wave: principal components" in text
        assert ("Whole curves" in text) == (shown == "y" or method.endswith("second_order"))


def test_a_curve_without_results_is_drawn_too_and_an_unknown_one_is_a_sentence() -> None:
    for method in ("morris", "saltelli"):
        empty = analyse(plan_of(study(method, "wave")), [])
        on_paper(curve(empty, "wave", "N"))
        on_paper(components(empty, "wave", "N"))
        with pytest.raises(ValueError, match="no curve 'torque': it has wave"):
            curve(empty, "torque")


def test_the_terminal_shows_whole_curves(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from rehyb.cli.study.studies import _print_indices

    described = study("saltelli", "y", "wave")
    one = chapter(described, table_of(described, tmp_path / "r.csv"))
    _print_indices(dict(one.snapshot), {"rows_complete": 8, "rows": 8}, None)
    said = capsys.readouterr().out
    assert "wave, the whole curve" in said and "more rows" in said


def test_interactions_of_pairs_are_a_heat_map_and_no_other_study_has_one(tmp_path: Path) -> None:
    described = study("saltelli_second_order", "y", "wave")
    snapshot = chapter(described, table_of(described, tmp_path / "r.csv")).snapshot
    figure = interactions(snapshot, "y")
    drawn = on_paper(figure)
    # Bars, the map, and its colours.
    assert len(drawn.axes) == 3
    shares = drawn.axes[1].collections[0].get_array()
    alone = snapshot["outputs"]["y"]["factors"]["b"]["first_order"]["value"]
    assert shares is not None and shares[0, 0] == alone == figure["data"][-1]["z"][0][0]
    on_paper(interactions(analyse(plan_of(described), []), "y"))
    with pytest.raises(ValueError, match="method saltelli_second_order"):
        interactions(analyse(plan_of(study("saltelli", "y", "wave")), []), "y")


def test_a_report_of_groups_names_the_groups(tmp_path: Path) -> None:
    described = study("saltelli_second_order", "y") | {"curves": {}, "groups": {"late": ["b", "c"]}}
    csv = table_of(described, tmp_path / "r.csv")
    page, *_ = write_report(tmp_path / "r.html", [chapter(described, csv)], "y", {}, title="t")
    assert "late" in page.read_text()
