"""A report is written from what the coordinator has, or refused in one sentence."""

from pathlib import Path
from typing import Any

import pytest

from rehyb.errors import Invalid
from rehyb.reports import report_studies

STUDY: dict[str, Any] = {
    "id": "s1",
    "name": "try",
    "model": "ishigami",
    "method": "saltelli",
    "sampling": "sobol",
    "rows": 1,
    "seed": 1,
    "factors": [
        {"name": "x1", "distribution": {"kind": "uniform", "low": 0.0, "high": 1.0}},
        {"name": "x2", "distribution": {"kind": "uniform", "low": 0.0, "high": 1.0}},
    ],
    "fixed": {"x3": 0.0},
    "outputs": ["y"],
}


class Coordinator:
    """A client of a coordinator with one study of one row."""

    def study(self, study_id: str) -> dict[str, Any]:
        return STUDY

    def results_csv(self, study_id: str, path: Path) -> None:
        lines = ["row,position,x1,x2,outcome,y"]
        lines += [f"0,{position},0.{position},0.5,ok,1.{position}" for position in range(4)]
        path.write_text("\n".join(lines) + "\n")


def test_a_report_is_one_page_and_pictures_where_asked(tmp_path: Path) -> None:
    client: Any = Coordinator()
    files = report_studies(
        client, ["s1"], tmp_path / "r.html", output=None, folders={"png": tmp_path / "png"}
    )
    assert files[0] == tmp_path / "r.html"
    assert "Sensitivity of y: try" in files[0].read_text()
    assert sorted(files) == sorted([tmp_path / "r.html", *(tmp_path / "png").iterdir()])


def test_an_output_the_study_does_not_have_is_refused(tmp_path: Path) -> None:
    client: Any = Coordinator()
    with pytest.raises(Invalid, match="study s1 has no output 'z': it has y"):
        report_studies(client, ["s1"], tmp_path / "r.html", output="z")
    assert not list(tmp_path.iterdir())
