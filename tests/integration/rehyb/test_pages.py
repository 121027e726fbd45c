"""Pages and figures about studies that a coordinator has, written in full."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rehyb.campaign.plans import Plan
from rehyb.campaign.run import Campaign
from rehyb.reports import report_studies
from tests.testbed.coordinators.finished_study import FinishedStudy, weighted_sum
from tests.testbed.coordinators.instant import InstantCoordinator

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def coordinator(talk_to: Callable[[FinishedStudy], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """A coordinator with a study of a weighted sum."""
    monkeypatch.setenv("COLUMNS", "200")
    talk_to(weighted_sum())


@pytest.mark.usefixtures("coordinator")
def test_a_surrogate_stands_beside_the_sampled_indices(run: Run) -> None:
    status, out, _ = run("study", "surrogate", "s1")
    assert status == 0
    assert out.index("x1") < out.index("x2")
    assert "0.900, 0.900" in out and "ST sampled" in out
    assert "the surrogate's indices are worth reading" in out
    answer = json.loads(run("study", "surrogate", "s1", "--json")[1])
    assert answer["fit"]["runs"] == 32 and answer["outliers"] == []
    status, _, err = run("study", "surrogate", "s1", "--output", "z")
    assert (status, err) == (2, "rehyb: the study has no output 'z': it has y\n")


@pytest.mark.usefixtures("coordinator")
def test_a_report_says_which_files_it_wrote(run: Run, tmp_path: Path) -> None:
    status, out, _ = run("report", "s1", "--out", str(tmp_path / "r.html"), "--json")
    assert (status, json.loads(out)) == (0, {"files": [str(tmp_path / "r.html")]})


def test_a_report_is_one_page_and_pictures_where_asked(tmp_path: Path) -> None:
    client = FinishedStudy().client()
    files = report_studies(
        client, ["s1"], tmp_path / "r.html", output=None, folders={"png": tmp_path / "png"}
    )
    assert files[0] == tmp_path / "r.html"
    assert "Sensitivity of y: try" in files[0].read_text()
    assert sorted(files) == sorted([tmp_path / "r.html", *(tmp_path / "png").iterdir()])


def test_failures_of_both_phases_are_counted_by_cause_and_every_file_is_written(
    tmp_path: Path,
) -> None:
    plan = Plan(model="sobol_g", output="y", screening_rows=12, variance_rows=8)
    client: Any = InstantCoordinator()
    report = Campaign(
        client,
        plan,
        tmp_path,
        show=lambda view: None,
        tick=lambda: None,
        sleep=lambda seconds: None,
    ).run()
    assert report.failures == {"unstable": 3}
    assert report.instances == 12 * 7 + 8 * 7
    assert sorted(path.name for path in report.files) == sorted(p.name for p in tmp_path.iterdir())
    assert json.loads(json.dumps(report.to_json()))["files"] == [str(p) for p in report.files]
    page = (tmp_path / "report.html").read_text()
    assert "Screening by elementary effects" in page and "Variance-based indices" in page
    assert f"Phase 2 holds {report.fixed} at its nominal 0.5." in page
