"""Drawing up a study from a request."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.designs import instance_parameters
from server.errors import InvalidStudyError
from server.logic.study.plans import MAX_ROWS, FactorChoice, draw_up, refuse_outside_range
from server.logic.study.points import parameters
from server.logic.study.requests import refuse_too_few
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
        ({"sampling": "halton"}, "/sampling", "expected one of sobol"),
        (
            {"method": "saltelli", "sampling": "trajectories"},
            "/sampling",
            "expected one of sobol_blocks, sobol, sobol_paired, latin_hypercube",
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


def test_a_curve_over_the_phase_is_kept_only_if_it_is_named(plan: Drawing) -> None:
    drawn = plan(model="elbow", outputs=["torque_over_phase", "stiffness_error"])
    assert drawn.outputs[:2] == ("stiffness_error", "torque_over_phase[0]")
    assert len(drawn.outputs) == 102 and list(drawn.curves) == ["torque_over_phase"]
    assert drawn.curves["torque_over_phase"].over == "phase"
    assert plan(model="elbow").curves == {}


@pytest.mark.parametrize(
    ("outputs", "sentence"),
    [
        (["torque_over_phase", "torque_over_phase"], "torque_over_phase is listed twice"),
        (["torque_over_phase[3]"], "unknown output of elbow"),
        (["torque"], "unknown output of elbow"),
    ],
)
def test_a_curve_is_kept_whole_and_once(plan: Drawing, outputs: list[str], sentence: str) -> None:
    with pytest.raises(InvalidStudyError, match=sentence):
        plan(model="elbow", outputs=outputs)


def test_shapley_effects_of_a_curve_without_points_advise_to_leave_it_out(plan: Drawing) -> None:
    with pytest.raises(InvalidStudyError, match=r"torque_over_phase is a curve.*leave it out"):
        plan(model="elbow", method="shapley", outputs=["torque_over_phase"])


@pytest.mark.parametrize(
    ("asked", "pointer", "sentence"),
    [
        ({"rows": 513}, "/rows", "surrogate fits a function to 512 rows at most, not 513"),
        ({"groups": {"g": ["x1", "x3"]}}, "/groups", "surrogate looks at single factors"),
        (
            {"model": "elbow", "outputs": ["torque_over_phase"]},
            "/outputs/0",
            "torque_over_phase is a curve, and surrogate takes numbers only",
        ),
        (
            {"correlations": [["x1", "x2", 0.5]]},
            "/method",
            "surrogate tells a factor's part of its function from the others', as only independent "
            "ones do: with correlations the method is shapley or sample",
        ),
    ],
)
def test_what_no_function_is_fitted_to_is_refused(
    plan: Drawing, asked: dict[str, Any], pointer: str, sentence: str
) -> None:
    with pytest.raises(InvalidStudyError, match=sentence) as caught:
        plan(**{"method": "surrogate", "rows": 256, **asked})
    assert caught.value.pointer == pointer


@pytest.mark.parametrize(
    ("asked", "pointer", "sentence"),
    [
        (
            {"method": "saltelli"},
            "/method",
            "saltelli moves one factor and leaves the others alone, which dependent factors do not "
            "allow: with correlations the method is shapley or sample",
        ),
        (
            {"correlation_kind": "copula"},
            "/correlation_kind",
            "unknown correlation_kind 'copula': expected one of rank, linear",
        ),
        *(
            (
                {"correlations": [["x1", "x2", 0.5], wrong]},
                "/correlations/1",
                'a correlation is two factors and a number: ["a", "b", 0.6]',
            )
            for wrong in (
                ["x1", "x3"],
                ["x1", "x3", 0.5, 0.5],
                [1, "x3", 0.5],
                ["x1", 3, 0.5],
                ["x1", "x3", "0.5"],
                ["x1", "x3", None],
                ["x1", "x3", float("nan")],
                [],
            )
        ),
    ],
)
def test_how_factors_depend_is_said_by_two_names_and_a_number(
    plan: Drawing, asked: dict[str, Any], pointer: str, sentence: str
) -> None:
    with pytest.raises(InvalidStudyError) as refused:
        plan(**{"method": "sample", "correlations": [["x1", "x2", 0.5]], **asked})
    assert (refused.value.pointer, str(refused.value)) == (pointer, sentence)


@pytest.mark.parametrize(
    ("correlations", "pointer", "sentence"),
    [
        ([["x1", "x2", 0.5], ["x1", "y", 0.5]], "/correlations/1", "y is not sampled"),
        (
            [["x1", "x2", 0.9], ["x2", "x3", 0.9], ["x1", "x3", -0.9]],
            "/correlations",
            "^these correlations contradict each other",
        ),
    ],
)
def test_correlations_that_cannot_be_are_pointed_at_one_by_one_or_together(
    plan: Drawing, correlations: list[Any], pointer: str, sentence: str
) -> None:
    with pytest.raises(InvalidStudyError, match=sentence) as refused:
        plan(method="sample", correlations=correlations)
    assert refused.value.pointer == pointer


def test_a_study_keeps_which_correlation_was_meant(plan: Drawing) -> None:
    for kind in ("rank", "linear"):
        asked = {"correlations": [["x1", "x2", 0.5]], "correlation_kind": kind}
        dependence = plan(method="sample", **asked).dependence
        assert dependence is not None and dependence.kind == kind


def test_shapley_effects_of_groups_are_refused(plan: Drawing) -> None:
    with pytest.raises(InvalidStudyError, match=r"^shapley looks at single factors") as refused:
        plan(method="shapley", groups={"g": ["x1", "x3"]})
    assert refused.value.pointer == "/groups"


def test_a_factor_that_nobody_named_is_pointed_at_with_all_others(plan: Drawing) -> None:
    drawn = plan(model="elbow", factors=[FactorChoice(name="forearm_length", distribution=TALL)])
    with pytest.raises(InvalidStudyError, match=r"^forearm_length is") as refused:
        refuse_outside_range(drawn, ELBOW, [])
    assert refused.value.pointer == "/factors"


@pytest.mark.parametrize("method", ["surrogate", "shapley", "sample"])
def test_of_curves_alone_no_study_of_numbers_is_made(method: str) -> None:
    (whole,) = (one for one in ELBOW.results if one.name == "torque_over_phase")
    asked: dict[str, Any] = {"name": "curves", "called": "elbow", "sampling": "sobol_blocks"}
    asked |= {"rows": 256, "seed": 1, "factors": None, "fixed": {}, "outputs": None}
    for optional, said in (
        (False, r"keep points of it, such as torque_over_phase\["),
        (True, "every output of elbow is optional: name those to keep, of torque_over_phase"),
    ):
        only = replace(ELBOW, results=(replace(whole, optional=optional),))
        with pytest.raises(InvalidStudyError, match=said) as caught:
            draw_up(model=only, method=method, **asked)
        assert caught.value.pointer == "/outputs"


def test_a_surrogate_of_fewer_rows_than_its_first_function_is_refused(plan: Drawing) -> None:
    with pytest.raises(InvalidStudyError, match=r"first function to 128 rows.* of 127") as caught:
        refuse_too_few(plan(method="surrogate", rows=127))
    assert caught.value.pointer == "/rows"
    refuse_too_few(plan(method="surrogate", rows=128))
    refuse_too_few(plan(method="saltelli", rows=1))


def test_a_row_of_a_surrogate_is_a_single_point(plan: Drawing) -> None:
    drawn = plan(method="surrogate", rows=512)
    assert drawn.width == 1 and len(parameters(drawn, 511)) == 1


def test_a_sample_takes_correlations_and_as_many_rows_as_any_study(plan: Drawing) -> None:
    drawn = plan(method="sample", rows=MAX_ROWS, correlations=[["x1", "x2", 0.6]])
    assert drawn.width == 1 and drawn.dependence is not None
    alone = plan(method="sample", rows=MAX_ROWS)
    assert parameters(drawn, 7)[0]["x1"] == pytest.approx(parameters(alone, 7)[0]["x1"], rel=1e-12)
    assert parameters(drawn, 7)[0]["x2"] != parameters(alone, 7)[0]["x2"]


def test_a_study_of_groups_has_as_many_runs_a_row_as_groups_need(plan: Drawing) -> None:
    drawn = plan(method="saltelli", groups={"outer": ["x1", "x3"]})
    assert drawn.groups == {"outer": ("x1", "x3")} and drawn.width == 4
    points = parameters(drawn, 0)
    assert len(points) == 4 and points[2]["x3"] == points[1]["x3"]


@pytest.mark.parametrize(
    ("asked", "pointer", "sentence"),
    [
        ({"groups": {"g": ["x1", "x9"]}}, "/groups/g", "g has x9, which is not sampled"),
        ({"groups": {"g": ["x1"], "h": ["x1"]}}, "/groups/h", "x1 is in g and h"),
        ({"groups": {"g": []}}, "/groups/g", "g has no factors"),
        (
            {"groups": {"g": ["x1", "x2"]}, "method": "morris"},
            "/sampling",
            "sampling must be trajectories, not sobol",
        ),
        (
            {"groups": {"g": ["x1", "x2", "x3"]}, "method": "saltelli_second_order"},
            "/factors",
            "it needs two factors or more",
        ),
    ],
)
def test_groups_that_cannot_be_sampled_are_refused_with_their_place(
    plan: Drawing, asked: dict[str, Any], pointer: str, sentence: str
) -> None:
    with pytest.raises(InvalidStudyError, match=sentence) as caught:
        plan(**{"method": "saltelli", **asked})
    assert caught.value.pointer == pointer


def test_factors_that_depend_on_each_other_do_so_in_every_point(plan: Drawing) -> None:
    asked = {"method": "shapley", "rows": 64, "factors": None}
    drawn = plan(**asked, correlations=[["x1", "x2", 0.9]])
    bases = [parameters(drawn, row)[0] for row in range(64)]
    assert np.corrcoef([[one["x1"], one["x2"]] for one in bases], rowvar=False)[0, 1] > 0.7


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
