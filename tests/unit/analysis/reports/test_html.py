"""Pages are made of escaped pieces, and a picture is the same bytes each time."""

import pytest

from analysis.reports.html import cell, environment
from analysis.reports.tables import Grid


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "–"),
        (0.123456, "0.1235"),
        (7, "7"),
        ("<b>", "<b>"),
        ([1.23456, None, "Hz"], "1.235, –, Hz"),
        ({"value": None, "low": None, "high": None}, "–"),
        ({"value": 0.12345, "low": None, "high": None}, "0.123"),
        ({"value": 0.5763, "low": 0.3212, "high": 0.8512}, "0.58 <small>[0.32, 0.85]</small>"),
    ],
)
def test_a_cell_shows_a_value_with_the_digits_that_it_has(value: object, shown: str) -> None:
    assert cell(value) == shown


def test_names_from_outside_stay_text() -> None:
    grid = Grid(head=["<th>"], rows=[["<i>", {"value": 1.0, "low": 0.5, "high": 1.5}]], title="<&>")
    pieces = environment().get_template("macros.html").module
    text = pieces.grid(grid)  # type: ignore[attr-defined]
    assert "<h3>&lt;&amp;&gt;</h3>" in text and "<td>&lt;i&gt;</td>" in text
    assert "<th>&lt;th&gt;</th>" in text and "<td>1.00 <small>[0.50, 1.50]</small></td>" in text


def findings(*, after: float, unit: str) -> str:
    """Return the page's findings of one effect of one joint."""
    effect = {
        "name": "backlash",
        "where": "elbow",
        "parameters": {"side": {"value": -1.0, "ci90": [-1.0, -1.0], "unit": unit}},
        "evidence": {"holdout_gain": 0.2, "p_value": 0.001, "signature": "a jump"},
        "indistinguishable_from": [],
        "separating_trial": None,
        "mujoco_element": None,
    }
    error = {"before": 2.0, "after": after, "floor": 0.5, "unit": "Nm"}
    report = {
        "effects": [effect],
        "error": {"holdout": {"elbow": error}},
        "floor": {"elbow": {"from": "rest"}},
        "session": {"fit_cutoff_hz": 5.0},
        **{name: {} for name in ("impedance", "identified", "unexplained")},
        **{name: [] for name in ("warnings", "advice")},
    }
    return environment().get_template("close_loop_findings.html").render(report=report)


def test_what_has_no_dimension_has_no_unit_in_the_table_of_effects() -> None:
    assert "<td>-1, -1</td><td></td>" in findings(after=1.0, unit="1")
    assert "<td>-1, -1</td><td>rad</td>" in findings(after=1.0, unit="rad")


@pytest.mark.parametrize(
    ("after", "left"), [(0.5, "0 %"), (1.75, "75 %"), (2.0, "100 %"), (0.4, "0 %"), (2.1, "100 %")]
)
def test_the_table_of_errors_says_how_much_of_their_power_is_left(after: float, left: str) -> None:
    assert f"<td>2</td><td>{after:g}</td><td>{left}</td><td>0.5</td>" in findings(
        after=after, unit="1"
    )
