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
