"""A report is written from what the coordinator has, or refused in one sentence."""

from pathlib import Path

import pytest

from rehyb.errors import Invalid
from rehyb.reports import report_studies
from tests.testbed.finished_study import FinishedStudy


def test_a_report_is_one_page_and_pictures_where_asked(tmp_path: Path) -> None:
    client = FinishedStudy().client()
    files = report_studies(
        client, ["s1"], tmp_path / "r.html", output=None, folders={"png": tmp_path / "png"}
    )
    assert files[0] == tmp_path / "r.html"
    assert "Sensitivity of y: try" in files[0].read_text()
    assert sorted(files) == sorted([tmp_path / "r.html", *(tmp_path / "png").iterdir()])


def test_an_output_the_study_does_not_have_is_refused(tmp_path: Path) -> None:
    client = FinishedStudy().client()
    with pytest.raises(Invalid, match="study s1 has no output 'z': it has y"):
        report_studies(client, ["s1"], tmp_path / "r.html", output="z")
    assert not list(tmp_path.iterdir())
