"""What closing a loop prints."""

from pathlib import Path
from typing import Any

import pytest

from rehyb.cli.close_loop import _lines, naming_older
from rehyb.errors import Invalid


@pytest.mark.parametrize(("floor", "said"), [(0.02, "floor 0.02"), (None, "no floor")])
def test_a_channel_without_a_floor_is_printed_as_one(floor: float | None, said: str) -> None:
    error = {"before": 0.5, "after": 0.1, "floor": floor, "unit": "Nm"}
    report: dict[str, Any] = {
        "verdict": "unexplained",
        "effects": [],
        "error": {"holdout": {"elbow": error}},
        "impedance": {},
        "unexplained": {},
        "advice": [],
        "warnings": [],
    }
    assert f"  held-out error of elbow: 0.5 -> 0.1 Nm ({said})" in [*_lines(report, Path("out"))]


def test_what_is_refused_says_that_a_report_in_the_folder_is_older(tmp_path: Path) -> None:
    """Exit status 2 left it there, to be read as the answer."""

    def refused() -> str:
        with pytest.raises(Invalid) as caught, naming_older(tmp_path):
            raise Invalid("a.csv is wrong")
        return str(caught.value)

    assert refused() == "a.csv is wrong"
    (tmp_path / "report.json").touch()
    assert refused().startswith("a.csv is wrong") and "is an older answer" in refused()
