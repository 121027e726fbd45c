"""A campaign fixes what the paper would fix, says how sure it is, and resumes what it began."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from rehyb.campaign.decisions import Proposed
from rehyb.campaign.plans import PRESETS, Plan
from rehyb.campaign.run import Campaign, View
from rehyb.errors import CampaignError, Unreachable
from tests.testbed.coordinators.instant import InstantCoordinator

PLAN = Plan(model="sobol_g", output="y", screening_rows=12, variance_rows=8, seed=2)


def campaign(
    coordinator: InstantCoordinator,
    directory: Path,
    plan: Plan = PLAN,
    seen: list[View] | None = None,
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
    monkeypatch.setattr("analysis.reports.paper.on_paper", lambda *_: Figure())


@pytest.mark.usefixtures("no_drawing")
def test_phase_2_samples_the_other_factors_with_the_least_influential_at_nominal(
    tmp_path: Path,
) -> None:
    coordinator = InstantCoordinator()
    report = campaign(coordinator, tmp_path).run()
    first, second = coordinator.submitted.values()
    assert (first["method"], first["rows"], second["method"], second["rows"]) == (
        "morris",
        12,
        "saltelli",
        8,
    )
    assert {first["sampling"], second["sampling"]} == {"owen_blocks"}
    assert report.fixed in ("x5", "x6")
    assert second["fixed"] == {report.fixed: 0.5}
    sampled = [factor["name"] for factor in second["factors"]]
    assert sampled == [f"x{i}" for i in range(1, 7) if f"x{i}" != report.fixed]
    assert "10 % of the largest mu* (x1" in report.evidence
    assert "12 rows are too few to call a factor non-influential" in report.evidence


@pytest.mark.usefixtures("no_drawing")
def test_without_separation_it_fixes_the_least_influential_and_says_that_it_is_not_settled(
    tmp_path: Path,
) -> None:
    # Two arguments of the Ishigami function matter much and the third through interaction only.
    plan = Plan(model="ishigami", output="y", screening_rows=12, variance_rows=4)
    report = campaign(InstantCoordinator(), tmp_path, plan).run()
    assert not report.separated
    assert "does not settle it" in report.evidence
    assert report.evidence.endswith(f"factor all the same: {report.fixed}.")


@pytest.mark.usefixtures("no_drawing")
def test_phase_2_is_extended_until_it_is_precise_and_resumes_as_long_as_it_grew(
    tmp_path: Path,
) -> None:
    coordinator = InstantCoordinator()
    plan = replace(PLAN, most_rows=64, target=0.4)
    report = campaign(coordinator, tmp_path, plan).run()
    sizes = [study["rows"] for study in coordinator.submitted.values()]
    assert sizes == [12, report.phase2["rows"]]
    assert 8 < sizes[1] <= 64
    assert f"{sizes[1]} of {sizes[1]} complete" in (tmp_path / "report.html").read_text()
    assert (
        "Intervals of y are within ±0.4, but not to be trusted"
        in (tmp_path / "report.html").read_text()
    )
    again = campaign(coordinator, tmp_path, plan).run()
    assert again.phase2 == report.phase2


@pytest.mark.usefixtures("no_drawing")
def test_a_campaign_of_an_earlier_version_is_resumed(tmp_path: Path) -> None:
    coordinator = InstantCoordinator()
    campaign(coordinator, tmp_path).run()
    manifest = json.loads((tmp_path / "campaign.json").read_text())
    for later in ("most_rows", "target"):
        del manifest["plan"][later]
    (tmp_path / "campaign.json").write_text(json.dumps(manifest))
    campaign(coordinator, tmp_path).run()
    assert len(coordinator.submitted) == 2


@pytest.mark.usefixtures("no_drawing")
def test_what_is_fixed_is_what_somebody_agreed_to_and_asked_once_only(tmp_path: Path) -> None:
    coordinator, asked = InstantCoordinator(), list[Proposed]()

    def answering(answer: str | None) -> Campaign:
        running = campaign(coordinator, tmp_path)
        running.confirm = lambda proposed: (asked.append(proposed), answer)[1]
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
    coordinator = InstantCoordinator()
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
    coordinator = InstantCoordinator()
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
    assert (paper["screening_rows"], paper["variance_rows"]) == (150, 3000)
    assert paper["sampling"] == "latin_hypercube"


def test_another_plan_in_the_same_directory_is_refused(tmp_path: Path) -> None:
    campaign(InstantCoordinator(), tmp_path)
    other = Plan(model="sobol_g", output="y", screening_rows=13, variance_rows=8)
    with pytest.raises(CampaignError, match=r"\(screening_rows 12, not 13, seed 2, not 1\)"):
        campaign(InstantCoordinator(), tmp_path, other)


@pytest.mark.parametrize(
    ("content", "why"),
    [(b"{", "is no JSON"), (b"\xff", "is no JSON"), (b"[]", "is no manifest of a campaign")],
)
def test_a_broken_manifest_is_named_with_what_to_do(
    tmp_path: Path, content: bytes, why: str
) -> None:
    manifest = tmp_path / "campaign.json"
    manifest.write_bytes(content)
    with pytest.raises(CampaignError) as raised:
        campaign(InstantCoordinator(), tmp_path)
    said = str(raised.value)
    assert said.startswith(f"{manifest} {why}")
    assert said.endswith(": restore it, or use another directory to begin the campaign anew")
    assert manifest.read_bytes() == content


@pytest.mark.usefixtures("no_drawing")
def test_a_coordinator_that_goes_away_is_waited_for_and_the_view_says_so(tmp_path: Path) -> None:
    coordinator = InstantCoordinator()
    seen: list[View] = []
    running = campaign(coordinator, tmp_path, seen=seen)

    def go_away(view: View) -> None:
        if not seen:
            coordinator.away = 3
        seen.append(view)

    running.show = go_away
    running.run()
    assert [view.waiting for view in seen[1:4]] == ["no coordinator answers; trying again"] * 3


def test_a_coordinator_that_was_never_there_is_an_error_at_once(tmp_path: Path) -> None:
    coordinator = InstantCoordinator()
    coordinator.away = 1
    with pytest.raises(Unreachable):
        campaign(coordinator, tmp_path).run()


def test_a_cancelled_study_ends_the_campaign(tmp_path: Path) -> None:
    coordinator = InstantCoordinator()
    coordinator.state = "cancelled"
    with pytest.raises(CampaignError, match="was cancelled"):
        campaign(coordinator, tmp_path).run()
