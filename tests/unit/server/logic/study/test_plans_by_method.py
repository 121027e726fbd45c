"""Drawing up a study of curves, groups or dependent factors, by each method."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from server.errors import InvalidStudyError
from server.logic.study.plans import MAX_ROWS, draw_up
from server.logic.study.points import parameters
from server.logic.study.requests import refuse_too_few
from server.records import Plan
from sim.models import ELBOW

Drawing = Callable[..., Plan]


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


@pytest.mark.parametrize("method", ["surrogate", "shapley", "sample"])
def test_of_curves_alone_no_study_of_numbers_is_made(method: str) -> None:
    (whole,) = (one for one in ELBOW.results if one.name == "torque_over_phase")
    asked: dict[str, Any] = {"name": "curves", "called": "elbow", "sampling": "owen_blocks"}
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
            "sampling must be random_trajectories, not sobol",
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
