"""Drawing up a study from a request."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from analysis.designs import instance_parameters
from server.errors import InvalidStudyError
from server.logic.study.plans import MAX_ROWS, FactorChoice, draw_up, refuse_outside_range
from server.logic.study.points import parameters
from server.records import Plan
from sim.models import ELBOW, SOBOL_G

Drawing = Callable[..., Plan]


def test_without_factors_those_of_the_paper_are_sampled_uniformly_over_their_ranges(
    plan: Drawing,
) -> None:
    drawn = plan(model="elbow")
    assert {name: d.to_json() for name, d in drawn.distributions.items()} == {
        f.name: {"kind": "uniform", "low": f.low, "high": f.high} for f in ELBOW.sampled
    }
    assert drawn.fixed == {f.name: f.nominal for f in ELBOW.factors if f.optional}
    assert drawn.outputs == ELBOW.outputs


def test_fixing_a_factor_leaves_the_others_sampled(plan: Drawing) -> None:
    drawn = plan(fixed={"x2": 0.5})
    assert list(drawn.distributions) == ["x1", "x3"]
    assert drawn.fixed == {"x2": 0.5}


def test_a_factor_neither_sampled_nor_fixed_keeps_its_nominal_value(plan: Drawing) -> None:
    drawn = plan(model="elbow", factors=[FactorChoice(name="forearm_mass")])
    assert list(drawn.distributions) == ["forearm_mass"]
    assert drawn.fixed["upper_arm_mass"] == ELBOW.factor("upper_arm_mass").nominal
    assert len(drawn.fixed) == len(ELBOW.factors) - 1


def test_factors_and_outputs_follow_the_model_whatever_order_they_are_asked_in(
    plan: Drawing,
) -> None:
    drawn = plan(
        model="elbow",
        factors=[FactorChoice(name="forearm_mass"), FactorChoice(name="upper_arm_length")],
        outputs=["tracking_rmse", "stiffness_error"],
    )
    assert list(drawn.distributions) == ["upper_arm_length", "forearm_mass"]
    assert drawn.outputs == ("stiffness_error", "tracking_rmse")


def test_a_choice_is_fixed_by_its_name_and_sampled_as_one_of_its_values(plan: Drawing) -> None:
    assert plan(model="elbow", fixed={"muscles": "physiological"}).fixed["muscles"] == 2.0
    drawn = plan(model="elbow", factors=[FactorChoice(name="muscles")])
    assert drawn.distributions["muscles"].to_json() == {
        "kind": "discrete",
        "values": [0.0, 1.0, 2.0],
        "probabilities": pytest.approx([1 / 3] * 3),
    }
    with pytest.raises(InvalidStudyError, match=r"muscles is a choice \(paper, holzbaur2005, phys"):
        plan(model="elbow", factors=[FactorChoice(name="muscles", range=(0.0, 1.0))])
    with pytest.raises(InvalidStudyError, match="muscles must be paper, holzbaur2005 or phys"):
        plan(model="elbow", fixed={"muscles": "mine"})
    with pytest.raises(InvalidStudyError, match="write muscles=paper for refitted_muscles=0"):
        plan(model="elbow", fixed={"refitted_muscles": 0.0})


@pytest.mark.parametrize(
    ("method", "width"), [("morris", 4), ("saltelli", 5), ("saltelli_second_order", 8)]
)
def test_a_study_has_rows_times_width_instances(plan: Drawing, method: str, width: int) -> None:
    drawn = plan(method=method, rows=7)
    assert (drawn.width, drawn.instances) == (width, 7 * width)


def test_parameters_are_the_design_s_with_fixed_factors_added(plan: Drawing) -> None:
    drawn = plan(fixed={"x2": 0.5}, seed=9, sampling="latin_hypercube")
    points = instance_parameters("morris", "latin_hypercube", 9, 1, drawn.distributions)
    assert parameters(drawn, 1) == [{**point, "x2": 0.5} for point in points]


@pytest.mark.parametrize(
    ("request_", "pointer", "says"),
    [
        ({"method": "fast"}, "/method", "expected one of morris, saltelli"),
        ({"sampling": "halton"}, "/sampling", "expected one of owen_blocks, sobol"),
        (
            {"method": "saltelli", "sampling": "trajectories"},
            "/sampling",
            "expected one of owen_blocks, sobol_blocks, sobol, sobol_paired, latin_hypercube",
        ),
        ({"rows": 0}, "/rows", "between 1 and"),
        ({"rows": MAX_ROWS + 1}, "/rows", "between 1 and"),
        ({"fixed": {"x9": 1.0}}, "/fixed/x9", "has no factor"),
        ({"fixed": {"x1": float("nan")}}, "/fixed/x1", "must be finite"),
        ({"factors": []}, "/factors", "at least one factor"),
        (
            {"method": "saltelli_second_order", "factors": [FactorChoice(name="x1")]},
            "/factors",
            "looks at pairs: it needs two factors or more",
        ),
        ({"fixed": {"x1": 0.0, "x2": 0.0, "x3": 0.0}}, "/factors", "at least one factor"),
        ({"factors": [FactorChoice(name="x9")]}, "/factors/0/name", "has no factor"),
        (
            {"factors": [FactorChoice(name="x1"), FactorChoice(name="x1")]},
            "/factors/1/name",
            "listed twice",
        ),
        (
            {"factors": [FactorChoice(name="x1")], "fixed": {"x1": 0.0}},
            "/factors/0/name",
            "both fixed and sampled",
        ),
        (
            {"factors": [FactorChoice(name="x1", range=(2.0, 1.0))]},
            "/factors/0/range",
            "low of a uniform distribution must be below high",
        ),
        (
            {"factors": [FactorChoice(name="x1", range=(1.0, 1.0 + 2e-16))]},
            "/factors/0/range",
            "x1 would vary by 2.22045e-16 only: by 2.2e-13 or more, or fix it",
        ),
        (
            {
                "factors": [
                    FactorChoice(
                        name="x1", distribution={"kind": "normal", "mean": 3.0, "sd": 1e-15}
                    )
                ]
            },
            "/factors/0/distribution",
            "only: by 4.4e-13 or more, or fix it",
        ),
        (
            {"factors": [FactorChoice(name="x1", distribution={"kind": "cauchy"})]},
            "/factors/0/distribution",
            "kind of a distribution must be one of",
        ),
        (
            {"factors": [FactorChoice(name="x1", range=(0.0, 1.0), distribution={"kind": "x"})]},
            "/factors/0",
            "a range or a distribution",
        ),
        ({"outputs": []}, "/outputs", "at least one output"),
        ({"outputs": ["z"]}, "/outputs/0", "expected one of y"),
        ({"outputs": ["y", "y"]}, "/outputs/1", "listed twice"),
    ],
)
def test_a_request_that_makes_no_sense_is_refused_with_where_and_why(
    plan: Drawing, request_: dict[str, Any], pointer: str, says: str
) -> None:
    with pytest.raises(InvalidStudyError, match=says) as caught:
        plan(**request_)
    assert caught.value.pointer == pointer


WIDE = {"kind": "uniform", "low": 0.3, "high": 0.45}
TALL = {"kind": "normal", "mean": 0.32, "sd": 0.1}
RARE = {"kind": "normal", "mean": 0.32, "sd": 0.02}


@pytest.mark.parametrize(
    ("request_", "pointer", "sentence"),
    [
        (
            {"fixed": {"forearm_length": 0.45}},
            "/fixed/forearm_length",
            "forearm_length is 0.45 m, far outside 0.2827 to 0.3455, .* take 0.2199 to 0.4083",
        ),
        (
            {"factors": [("forearm_mass", None), ("forearm_length", WIDE)]},
            "/factors/1",
            "forearm_length is 0.45 m",
        ),
        ({"factors": [("forearm_length", TALL)]}, "/factors/0", "forearm_length is 0.0109"),
        ({"fixed": {"activation": 1.0}}, "/fixed/activation", "activation is 1, far outside"),
    ],
)
def test_a_study_far_outside_what_its_model_was_validated_for_is_refused(
    plan: Drawing, request_: dict[str, Any], pointer: str, sentence: str
) -> None:
    factors = [FactorChoice(name=n, distribution=d) for n, d in request_.get("factors", ())]
    drawn = plan(model="elbow", **{**request_, "factors": factors or None})
    with pytest.raises(InvalidStudyError, match=sentence) as refusal:
        refuse_outside_range(drawn, ELBOW, [choice.name for choice in factors])
    assert refusal.value.pointer == pointer


@pytest.mark.parametrize(
    "request_",
    [
        {},
        {"fixed": {"forearm_length": 0.36, "muscles": "physiological", "cuff_compliance": 0.0}},
        {"factors": [FactorChoice(name="forearm_length", distribution=RARE)]},
    ],
)
def test_a_study_within_or_near_the_ranges_is_taken(
    plan: Drawing, request_: dict[str, Any]
) -> None:
    drawn = plan(model="elbow", **request_)
    refuse_outside_range(drawn, ELBOW, list(drawn.distributions))


def test_a_factor_that_nobody_named_is_pointed_at_with_all_others(plan: Drawing) -> None:
    drawn = plan(model="elbow", factors=[FactorChoice(name="forearm_length", distribution=TALL)])
    with pytest.raises(InvalidStudyError, match=r"^forearm_length is") as refused:
        refuse_outside_range(drawn, ELBOW, [])
    assert refused.value.pointer == "/factors"


def test_a_kept_model_whose_names_clash_with_columns_of_results_is_not_sampled_again() -> None:
    outputs = tuple(replace(output, name="row") for output in SOBOL_G.results)
    kept = replace(SOBOL_G, results=outputs)
    with pytest.raises(InvalidStudyError, match="row is what a column of every table") as refusal:
        draw_up(
            name="a study",
            model=kept,
            called=kept.version,
            method="morris",
            sampling="sobol",
            rows=2,
            seed=1,
            factors=None,
            fixed={},
            outputs=None,
        )
    assert refusal.value.pointer == "/model"
