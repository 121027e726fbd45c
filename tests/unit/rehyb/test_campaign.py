"""A campaign fixes what the paper would fix, says how sure it is, and resumes what it began."""

import csv
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from analysis.designs import instance_parameters
from analysis.designs.distributions import Distribution
from analysis.sensitivity.service import LoggedResult, StudyPlan, analyse
from rehyb.campaign.decisions import Proposed
from rehyb.campaign.plans import PRESETS, Plan
from rehyb.campaign.run import Campaign, View
from rehyb.errors import CampaignError, Unreachable
from sim.evaluation import evaluate
from sim.models import MODELS
from tests.testbed.studies import results_of

PLAN = Plan(model="sobol_g", output="y", screening_rows=12, variance_rows=8)


class Coordinator:
    """A client whose studies are computed on the spot."""

    def __init__(self) -> None:
        self.submitted: dict[str, dict[str, Any]] = {}
        self.state = "complete"
        self.away = 0

    def submit(self, study: dict[str, Any], idempotency_key: str) -> dict[str, Any]:
        self._answer()
        self.submitted.setdefault(idempotency_key, dict(study))
        return self._shown(idempotency_key)

    def extend(self, study_id: str, rows: int) -> dict[str, Any]:
        self._answer()
        self.submitted[study_id]["rows"] = rows
        return self._shown(study_id)

    def _shown(self, study_id: str) -> dict[str, Any]:
        study = self.submitted[study_id]
        plan, distributions, _ = evaluated(study_id, study)
        return {
            **study,
            "id": study_id,
            "outputs": list(plan.outputs),
            "factors": [
                {"name": name, "distribution": distribution.to_json()}
                for name, distribution in distributions.items()
            ],
            "fixed": study.get("fixed", {}),
        }

    def progress(self, study_id: str) -> dict[str, Any]:
        self._answer()
        study = self.submitted[study_id]
        return {
            "study": study_id,
            "state": self.state,
            "instances": study["rows"] * 7,
            "rows": study["rows"],
            "workers": 1,
            "failures": {"unstable": 2} if study["method"] == "morris" else {"unstable": 1},
        }

    def indices(self, study_id: str) -> dict[str, Any]:
        self._answer()
        plan, _, results = evaluated(study_id, self.submitted[study_id])
        return analyse(plan, results)

    def results_csv(self, study_id: str, path: Path) -> None:
        plan, distributions, results = evaluated(study_id, self.submitted[study_id])
        with path.open("w", newline="") as file:
            lines = csv.writer(file)
            lines.writerow(["row", "position", *distributions, "outcome", *plan.outputs])
            for result in results:
                point = instance_parameters(
                    plan.method, plan.sampling, plan.seed, result.row, distributions
                )[result.position]
                values = [result.outputs[name] for name in plan.outputs]
                lines.writerow([result.row, result.position, *point.values(), "ok", *values])

    def _answer(self) -> None:
        if self.away:
            self.away -= 1
            raise Unreachable("no coordinator answers")


def evaluated(
    study_id: str, study: dict[str, Any]
) -> tuple[StudyPlan, dict[str, Distribution], list[LoggedResult]]:
    """Return a study's plan, its factors' distributions, and every result."""
    ranges = {f.name: [f.low, f.high] for f in MODELS[study["model"]].factors}
    ranges = {f["name"]: f["range"] for f in study.get("factors", ())} or ranges
    distributions = {
        name: Distribution.from_json({"kind": "uniform", "low": low, "high": high})
        for name, (low, high) in ranges.items()
    }
    plan = StudyPlan(
        id=study_id,
        method=study["method"],
        seed=study["seed"],
        sampling=study["sampling"],
        rows=study["rows"],
        factors=tuple(distributions),
        outputs=("y",),
    )

    def outputs(point: Mapping[str, float]) -> Mapping[str, float]:
        return evaluate(study["model"], {**point, **study.get("fixed", {})}).outputs

    return plan, distributions, results_of(plan, outputs, distributions=distributions)


def campaign(
    coordinator: Coordinator, directory: Path, plan: Plan = PLAN, seen: list[View] | None = None
) -> Campaign:
    views = [] if seen is None else seen
    return Campaign(
        coordinator,  # type: ignore[arg-type]
        plan,
        directory,
        show=views.append,
        tick=lambda: None,
        sleep=lambda seconds: None,
    )


@pytest.fixture
def no_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures out: they take seconds, and one test draws them."""
    monkeypatch.setattr("analysis.reports.report.pictures", lambda *_: [])
    monkeypatch.setattr("analysis.reports.figures.campaign_figure", lambda *_: Figure())


@pytest.mark.usefixtures("no_drawing")
def test_phase_2_samples_the_other_factors_with_the_least_influential_at_nominal(
    tmp_path: Path,
) -> None:
    coordinator = Coordinator()
    report = campaign(coordinator, tmp_path).run()
    first, second = coordinator.submitted.values()
    assert (first["method"], first["rows"], second["method"], second["rows"]) == (
        "morris",
        12,
        "saltelli",
        8,
    )
    assert {first["sampling"], second["sampling"]} == {"sobol_blocks"}
    assert report.fixed in ("x5", "x6")
    assert second["fixed"] == {report.fixed: 0.5}
    sampled = [factor["name"] for factor in second["factors"]]
    assert sampled == [f"x{i}" for i in range(1, 7) if f"x{i}" != report.fixed]
    assert report.separated
    assert "10 % of the largest mu* (x1" in report.evidence


@pytest.mark.usefixtures("no_drawing")
def test_without_separation_it_fixes_the_least_influential_and_says_that_it_is_not_settled(
    tmp_path: Path,
) -> None:
    # Two arguments of the Ishigami function matter much and the third through interaction only.
    plan = Plan(model="ishigami", output="y", screening_rows=12, variance_rows=4)
    report = campaign(Coordinator(), tmp_path, plan).run()
    assert not report.separated
    assert "does not settle it" in report.evidence
    assert report.evidence.endswith(f"factor all the same: {report.fixed}.")


def test_failures_of_both_phases_are_counted_by_cause_and_every_file_is_written(
    tmp_path: Path,
) -> None:
    report = campaign(Coordinator(), tmp_path).run()
    assert report.failures == {"unstable": 3}
    assert report.instances == 12 * 7 + 8 * 7
    assert sorted(path.name for path in report.files) == sorted(p.name for p in tmp_path.iterdir())
    assert json.loads(json.dumps(report.to_json()))["files"] == [str(p) for p in report.files]
    page = (tmp_path / "report.html").read_text()
    assert "Screening by elementary effects" in page and "Variance-based indices" in page
    assert f"Phase 2 holds {report.fixed} at its nominal 0.5." in page


@pytest.mark.usefixtures("no_drawing")
def test_phase_2_is_extended_until_it_is_precise_and_resumes_as_long_as_it_grew(
    tmp_path: Path,
) -> None:
    coordinator = Coordinator()
    plan = replace(PLAN, most_rows=64, target=0.4)
    report = campaign(coordinator, tmp_path, plan).run()
    sizes = [study["rows"] for study in coordinator.submitted.values()]
    assert sizes == [12, report.phase2["rows"]]
    assert 8 < sizes[1] <= 64
    assert f"{sizes[1]} of {sizes[1]} complete" in (tmp_path / "report.html").read_text()
    assert "Every index of y is within ±0.4" in (tmp_path / "report.html").read_text()
    again = campaign(coordinator, tmp_path, plan).run()
    assert again.phase2 == report.phase2


@pytest.mark.usefixtures("no_drawing")
def test_a_campaign_of_an_earlier_version_is_resumed(tmp_path: Path) -> None:
    coordinator = Coordinator()
    campaign(coordinator, tmp_path).run()
    manifest = json.loads((tmp_path / "campaign.json").read_text())
    for later in ("most_rows", "target"):
        del manifest["plan"][later]
    (tmp_path / "campaign.json").write_text(json.dumps(manifest))
    campaign(coordinator, tmp_path).run()
    assert len(coordinator.submitted) == 2


@pytest.mark.usefixtures("no_drawing")
def test_what_is_fixed_is_what_somebody_agreed_to_and_asked_once_only(tmp_path: Path) -> None:
    coordinator, asked = Coordinator(), list[Proposed]()

    def answering(answer: str | None) -> Campaign:
        running = campaign(coordinator, tmp_path)
        running._confirm = lambda proposed: (asked.append(proposed), answer)[1]
        return running

    with pytest.raises(CampaignError, match="nothing was fixed, and phase 2 waits"):
        answering(None).run()
    assert len(coordinator.submitted) == 1
    report = answering("x3").run()
    assert (report.fixed, report.separated) == ("x3", False)
    assert report.evidence.endswith("Asked, the user fixed x3 instead.")
    assert answering("x1").run().fixed == "x3"
    assert [proposed.factor for proposed in asked] == [asked[0].factor] * 2
    assert asked[0].factor in ("x5", "x6") and asked[0].value == "0.5"
    assert set(asked[0].factors) == {f"x{i}" for i in range(1, 7)}


@pytest.mark.usefixtures("no_drawing")
def test_a_second_run_submits_the_same_studies_under_the_same_keys(tmp_path: Path) -> None:
    coordinator = Coordinator()
    first = campaign(coordinator, tmp_path).run()
    submitted = dict(coordinator.submitted)
    second = campaign(coordinator, tmp_path).run()
    assert coordinator.submitted == submitted
    assert (second.fixed, second.evidence) == (first.fixed, first.evidence)
    assert second.seconds > first.seconds


@pytest.mark.usefixtures("no_drawing")
def test_a_resumed_campaign_submits_what_it_began_even_if_it_would_word_it_differently_now(
    tmp_path: Path,
) -> None:
    coordinator = Coordinator()
    campaign(coordinator, tmp_path).run()
    manifest = json.loads((tmp_path / "campaign.json").read_text())
    for phase in manifest["phases"]:
        phase["study"]["name"] = "worded by an earlier version"
    (tmp_path / "campaign.json").write_text(json.dumps(manifest))
    coordinator.submitted.clear()
    campaign(coordinator, tmp_path).run()
    names = {study["name"] for study in coordinator.submitted.values()}
    assert names == {"worded by an earlier version"}


def test_the_papers_campaign_is_a_preset() -> None:
    paper = PRESETS["paper"]
    assert (paper.screening_rows, paper.variance_rows) == (150, 3000)
    assert paper.sampling == "latin_hypercube"


def test_another_plan_in_the_same_directory_is_refused(tmp_path: Path) -> None:
    campaign(Coordinator(), tmp_path)
    other = Plan(model="sobol_g", output="y", screening_rows=13, variance_rows=8)
    with pytest.raises(CampaignError, match=r"holds a different campaign .*screening_rows 12"):
        campaign(Coordinator(), tmp_path, other)


@pytest.mark.usefixtures("no_drawing")
def test_a_coordinator_that_goes_away_is_waited_for_and_the_view_says_so(tmp_path: Path) -> None:
    coordinator = Coordinator()
    seen: list[View] = []
    running = campaign(coordinator, tmp_path, seen=seen)

    def go_away(view: View) -> None:
        if not seen:
            coordinator.away = 3
        seen.append(view)

    running._show = go_away
    running.run()
    assert [view.waiting for view in seen[1:4]] == ["no coordinator answers; trying again"] * 3


def test_a_coordinator_that_was_never_there_is_an_error_at_once(tmp_path: Path) -> None:
    coordinator = Coordinator()
    coordinator.away = 1
    with pytest.raises(Unreachable):
        campaign(coordinator, tmp_path).run()


def test_a_cancelled_study_ends_the_campaign(tmp_path: Path) -> None:
    coordinator = Coordinator()
    coordinator.state = "cancelled"
    with pytest.raises(CampaignError, match="was cancelled"):
        campaign(coordinator, tmp_path).run()
