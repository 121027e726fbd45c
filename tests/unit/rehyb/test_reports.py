"""A report is written from what the coordinator has, or refused in one sentence."""

from pathlib import Path

import pytest

from rehyb.bundle.archive import write_bundle
from rehyb.errors import Invalid
from rehyb.files import export
from rehyb.reports import report_studies
from tests.testbed.coordinators.finished_study import STUDY, FinishedStudy


def test_an_output_the_study_does_not_have_is_refused(tmp_path: Path) -> None:
    client = FinishedStudy().client()
    with pytest.raises(Invalid, match="study s1 has no output 'z': it has y"):
        report_studies(client, ["s1"], tmp_path / "r.html", output="z")
    assert not list(tmp_path.iterdir())


def test_a_kept_study_whose_names_clash_is_refused_by_what_reads_its_table(tmp_path: Path) -> None:
    client = FinishedStudy(STUDY | {"outputs": ["outcome"]}).client()
    told = "study s1 gives its results.csv only, .*: outcome is what a column .* rename this output"
    with pytest.raises(Invalid, match=told):
        report_studies(client, ["s1"], tmp_path / "r.html", output=None)
    with pytest.raises(Invalid, match=told):
        export(client, "s1", tmp_path / "r.nc", "netcdf")
    with pytest.raises(Invalid, match=told):
        write_bundle(client, "s1", tmp_path / "r.zip")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["png", "pdf"])
def test_a_file_as_the_folder_of_figures_is_refused_by_what_is_wanted(
    kind: str, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    told = f"file is no folder; name one for the figures as {kind.upper()}"
    with pytest.raises(Invalid, match=told):
        report_studies(
            FinishedStudy().client(),
            ["s1"],
            tmp_path / "r.html",
            output=None,
            folders={kind: tmp_path / "file"},
        )
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
