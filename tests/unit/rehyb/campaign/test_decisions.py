"""What a campaign decides follows from its plan and from what its studies have found."""

from dataclasses import replace
from typing import Any

import pytest

from models.folder import read_folder
from rehyb.campaign.decisions import (
    Proposed,
    decided,
    next_step,
    screening_phase,
    standing,
    variance_phase,
)
from rehyb.campaign.plans import Plan
from rehyb.errors import CampaignError, Invalid
from tests.testbed.coordinators.finished_study import STUDY, FinishedStudy
from tests.testbed.models import EXAMPLES

PLAN = Plan(model="elbow", output="stiffness_error", screening_rows=4, variance_rows=8)


def test_phase_2_holds_what_is_fixed_at_its_nominal_value_and_samples_the_others() -> None:
    first, second = screening_phase(PLAN), variance_phase(PLAN, "forearm_mass")
    assert (first.number, first.study["method"], first.study["rows"]) == (1, "morris", 4)
    assert (second.number, second.study["method"], second.study["rows"]) == (2, "saltelli", 8)
    assert list(second.study["fixed"]) == ["forearm_mass"]
    assert "forearm_mass" not in [factor["name"] for factor in second.study["factors"]]
    assert second.title.startswith("variance (Sobol indices), forearm_mass fixed at ")
    assert second.title.endswith(" kg")


def test_a_campaign_may_fix_a_choice_and_take_other_lengths() -> None:
    """The authors' code takes 10 % round the nominal lengths; aligned wearers have these."""
    ten = replace(PLAN, ranges="aligned10", fixed={"muscles": 1.0})
    first, second = screening_phase(ten).study, variance_phase(ten, "upper_arm_mass").study
    assert first["fixed"] == {"muscles": 1.0}
    assert second["fixed"] == {"muscles": 1.0, "upper_arm_mass": 1.761}
    ranges = {factor["name"]: factor["range"] for factor in first["factors"]}
    assert ranges["upper_arm_length"] == pytest.approx([0.30033, 0.36707])
    assert ranges["forearm_mass"] == [0.1, 1.82]
    aligned = screening_phase(replace(PLAN, ranges="aligned")).study
    assert aligned["fixed"] == {"upper_arm_length": 0.3337, "forearm_length": 0.319}
    assert len(aligned["factors"]) == 4


def test_a_campaign_goes_far_outside_a_range_only_if_it_is_asked_to() -> None:
    far = replace(PLAN, fixed={"friction": 9.0})
    assert "outside_range" not in screening_phase(far).study
    asked = replace(far, outside_range=True)
    assert screening_phase(asked).study["outside_range"] is True
    assert variance_phase(asked, "upper_arm_mass").study["outside_range"] is True


@pytest.mark.parametrize(
    ("progress", "seen", "answer"),
    [
        ({"state": "running", "workers": 2}, 0, (False, "")),
        ({"state": "running", "workers": 0}, 0, (False, "waiting for a worker")),
        (
            {"state": "running", "workers": 0, "why_it_waits": "this worker has code b"},
            0,
            (False, ""),
        ),
        (
            {"state": "complete", "rows": 8},
            7,
            (False, "all results are in; the analysis has seen 7 of 8 rows"),
        ),
        ({"state": "complete", "rows": 8}, 8, (True, "")),
    ],
)
def test_indices_are_final_when_the_analysis_has_seen_every_row(
    progress: dict[str, Any], seen: int, answer: tuple[bool, str]
) -> None:
    assert standing(progress, {"rows_complete": seen}) == answer


def test_a_cancelled_study_ends_the_campaign() -> None:
    with pytest.raises(CampaignError, match="study s was cancelled"):
        standing({"state": "cancelled", "study": "s"}, {})


def test_only_phase_2_has_a_precision_goal() -> None:
    sizes: dict[str, Any] = {"screening_rows": 4, "variance_rows": 32}
    plan = Plan(model="ishigami", output="y", most_rows=100, target=0.001, **sizes)
    first, second = screening_phase(plan), variance_phase(plan, "x3")
    snapshot = FinishedStudy(STUDY | {"rows": 32}, lost=()).indices
    assert next_step(plan, first, snapshot, 32) is None
    step = next_step(plan, second, snapshot, 32)
    assert step is not None and step.rows == 64
    without = Plan(model="ishigami", output="y", **sizes)
    assert next_step(without, second, snapshot, 32) is None
    other = Plan(model="ishigami", output="z", most_rows=100, **sizes)
    with pytest.raises(Invalid, match="has no output 'z': it has y"):
        next_step(other, second, snapshot, 32)


@pytest.mark.parametrize(
    ("agreed", "separated", "expected", "evidence"),
    [
        ("x3", True, True, "It is idle."),
        ("x3", False, False, "It is idle."),
        ("x1", True, False, "It is idle. Asked, the user fixed x1 instead."),
    ],
)
def test_a_decision_says_whether_the_screening_supports_it(
    agreed: str, separated: bool, expected: bool, evidence: str
) -> None:
    proposed = Proposed(
        factor="x3",
        value="0",
        evidence="It is idle.",
        separated=separated,
        factors=("x3", "x1"),
        snapshot={},
    )
    decision = {"fixed": agreed, "separated": expected, "evidence": evidence}
    assert decided(proposed, agreed) == decision


def test_a_model_of_one_s_own_brings_its_factors_along() -> None:
    described = read_folder(EXAMPLES / "noisy_pendulum").description
    plan = Plan(
        model=described.version,
        output="rest_angle",
        screening_rows=4,
        variance_rows=8,
        described=described.as_json(),
    )
    screening = screening_phase(plan).study
    assert screening["model"] == described.version
    ranges = {factor["name"]: factor["range"] for factor in screening["factors"]}
    assert ranges == {"stiffness": [5.0, 20.0], "motor_gain": [0.8, 1.2], "seed": [0.0, 2.0**32]}
    ranking = variance_phase(plan, "motor_gain")
    assert ranking.study["fixed"] == {"motor_gain": 1.0}
    assert [factor["name"] for factor in ranking.study["factors"]] == ["stiffness", "seed"]
