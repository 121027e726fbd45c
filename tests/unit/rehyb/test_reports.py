"""A report is written from what the coordinator has, or refused in one sentence."""

from pathlib import Path

import pytest

from rehyb.errors import Invalid
from rehyb.reports import report_studies
from tests.testbed.coordinators.finished_study import FinishedStudy


def test_an_output_the_study_does_not_have_is_refused(tmp_path: Path) -> None:
    client = FinishedStudy().client()
    with pytest.raises(Invalid, match="study s1 has no output 'z': it has y"):
        report_studies(client, ["s1"], tmp_path / "r.html", output="z")
    assert not list(tmp_path.iterdir())
