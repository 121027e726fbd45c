"""A description says what a model maps, and two that evaluate alike have one digest."""

import json
from copy import deepcopy
from math import inf
from typing import Any

import pytest

from models.curves import MAX_POINTS, Curve
from models.description import MAX_FACTORS, MAX_OUTPUTS, Description, complete
from models.entries import RESULT_COLUMNS, DescriptionError
from models.factors import Factor

SAID: dict[str, Any] = {
    "name": "pendulum",
    "description": "it swings",
    "kind": "command",
    "factors": [
        {
            "name": "stiffness",
            "unit": "Nm/rad",
            "low": 5,
            "high": 20.0,
            "nominal": 10.0,
            "description": "of the spring",
            "bounds": [0, None],
        }
    ],
    "outputs": [{"name": "angle", "unit": "rad"}, {"name": "path", "unit": "m", "curve": 3}],
    "time_limit": 60,
}


def said(**changes: Any) -> dict[str, Any]:
    """Return the description above with other entries."""
    return {**deepcopy(SAID), **changes}


def test_what_is_read_can_be_written_and_read_again() -> None:
    read = Description.from_json(SAID)
    written = json.loads(json.dumps(read.as_json(), allow_nan=False))
    assert Description.from_json(written) == read
    assert written["factors"][0]["bounds"] == [0.0, None]
    assert written["factors"][0]["choices"] == []
    assert read.factor("stiffness").bounds == (0.0, inf)
    assert read.description == "it swings"
    with pytest.raises(KeyError, match="mass"):
        read.factor("mass")


def test_what_need_not_be_said_is_nothing() -> None:
    bare = {name: SAID[name] for name in ("name", "kind", "factors", "outputs")}
    read = Description.from_json(bare)
    assert (read.description, read.code, read.time_limit) == ("", "", None)
    assert read.deterministic


AXIS = {"over": "phase", "over_unit": "rad", "low": -1.0, "high": 2.0}


def test_a_curve_lies_over_its_axis_and_may_be_left_out() -> None:
    asked = said(outputs=[{"name": "y", "unit": "m", "curve": 2, **AXIS, "optional": True}])
    read = Description.from_json(asked)
    assert read.curves == {"y": Curve(points=2, over="phase", unit="rad", low=-1.0, high=2.0)}
    assert Description.from_json(read.as_json()) == read
    assert read.outputs == ()


def test_limits_may_be_reached() -> None:
    for limit in (0.5, 1e7):
        assert Description.from_json(said(time_limit=limit)).time_limit == limit
    factors = [{**FACTOR, "name": f"f{i}"} for i in range(MAX_FACTORS)]
    assert len(Description.from_json(said(factors=factors)).factors) == MAX_FACTORS
    curve = {"name": "y", "unit": "m", "curve": MAX_OUTPUTS - 1}
    outputs = [{"name": "z", "unit": "m"}, curve]
    assert len(Description.from_json(said(outputs=outputs)).units) == MAX_OUTPUTS
    alone = {**curve, "curve": MAX_POINTS}
    assert len(Description.from_json(said(outputs=[alone])).units) == MAX_POINTS


def test_a_curve_is_as_many_numbers_as_it_has_points() -> None:
    units = Description.from_json(SAID).units
    assert units == {"angle": "rad", "path[0]": "m", "path[1]": "m", "path[2]": "m"}


def test_a_digest_tells_what_decides_an_answer_and_not_what_people_call_it() -> None:
    digest = Description.from_json(SAID).digest
    assert Description.from_json(said(description="it hangs")).digest == digest
    assert Description.from_json(said(code="ab")).digest != digest
    assert Description.from_json(said(time_limit=61)).digest != digest
    assert len(Description.from_json(said(name="x" * 40)).version) <= 64


def test_a_factor_that_is_left_out_is_nominal() -> None:
    model = Description.from_json(SAID)
    assert complete(model, {}) == {"stiffness": 10.0}
    assert complete(model, {"stiffness": 12}) == {"stiffness": 12.0}
    with pytest.raises(ValueError, match="pendulum has no factor 'mass': it has stiffness"):
        complete(model, {"mass": 1.0})
    with pytest.raises(ValueError, match="stiffness must be finite"):
        complete(model, {"stiffness": inf})


FACTOR = SAID["factors"][0]


@pytest.mark.parametrize(
    ("wrong", "field", "words"),
    [
        ([], "model", "must be a table"),
        (said(name="Pendulum"), "model.name", "a to z"),
        (said(name="x" * 41), "model.name", "1 to 40"),
        (said(name="a@b"), "model.name", "a to z"),
        (said(name="X" * 81), "model.name", f"{'X' * 80!r} must be"),
        (said(kind="x" * 81), "model.kind", f"{'x' * 80!r} must be"),
        (
            said(time_limit=10000001),
            "model.time_limit",
            "at most 1e7 s, not 1e+07",
        ),
        (said(kind="fmu"), "model.kind", "mjcf, python, command, umbridge"),
        (said(factor=[]), "model.factor", "is unknown"),
        (said(time_limit=0), "model.time_limit", "above 0"),
        (said(time_limit=float("nan")), "model.time_limit", "above 0"),
        (said(factors=[]), "factors", "at least one factor"),
        (said(factors=[FACTOR, FACTOR]), "factors[1].name", "listed twice"),
        (said(factors=[{**FACTOR, "low": 30}]), "factors[0].high", "must lie above low"),
        (
            said(
                factors=[{**FACTOR, "low": 0, "high": 1, "nominal": 0, "choices": ["a", "b\u202e"]}]
            ),
            "factors[0].choices",
            "must be names of characters that can be seen",
        ),
        (
            said(factors=[{**FACTOR, "low": 1.0, "high": 1.0 + 2e-16, "nominal": 1.0}]),
            "factors[0].high",
            "by their last digits; it must be 2.2e-13 or more",
        ),
        (said(factors=[{**FACTOR, "low": -1e308, "high": 1e308}]), "factors[0].high", "above"),
        (said(factors=[{**FACTOR, "low": 10**400}]), "factors[0].low", "too large"),
        (said(factors=[{**FACTOR, "low": -1}]), "factors[0].low", "outside the bounds"),
        (said(factors=[{**FACTOR, "low": "5"}]), "factors[0].low", "must be a number"),
        (said(factors=[{**FACTOR, "nominal": None}]), "factors[0].nominal", "is missing"),
        (said(factors=[{**FACTOR, "nominal": inf}]), "factors[0].nominal", "must be finite"),
        (said(factors=[{**FACTOR, "bounds": [1]}]), "factors[0].bounds", "two numbers"),
        (said(factors=[{**FACTOR, "name": "a b"}]), "factors[0].name", "letters, digits"),
        (said(factors=[FACTOR] * 1001), "factors", "at most 1000"),
        (said(outputs=[]), "outputs", "at least one output"),
        (said(outputs=[{"name": "y"}]), "outputs[0].unit", "is missing"),
        (said(outputs=[{"name": "y", "unit": "m", "curve": 1}]), "outputs[0].curve", "2 to"),
        (said(outputs=[{"name": "y", "unit": "m", "curve": True}]), "outputs[0].curve", "whole"),
        *(
            (
                said(outputs=[{"name": "y", "unit": "m", name: value}]),
                f"outputs[0].{name}",
                "is for a curve only",
            )
            for name, value in AXIS.items()
        ),
        *(
            (
                said(outputs=[{"name": "y", "unit": "m", "curve": 2, "low": low, "high": high}]),
                "outputs[0].high",
                f"{high:g} must lie above low, {low:g}",
            )
            for low, high in ((1.0, 1.0), (2.0, 1.0), (-inf, 1.0), (1.0, inf))
        ),
        (said(outputs=[{"name": "y", "unit": "\n"}]), "outputs[0].unit", "one line"),
        (
            said(outputs=[{"name": f"y{i}", "unit": "m", "curve": 9000} for i in range(2)]),
            "outputs",
            "18000 numbers; at most 10000",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence_with_its_place(wrong: Any, field: str, words: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        Description.from_json(wrong)
    assert caught.value.field == field
    assert words in caught.value.problem


CHOICE = Factor(
    name="muscles",
    unit="1",
    low=0.0,
    high=2.0,
    nominal=0.0,
    description="which",
    choices=("first", "second", "last"),
)


@pytest.mark.parametrize("text", ["2", "2.0", "2e0", "last"])
def test_a_choice_is_told_by_its_name_or_its_number_however_that_is_written(text: str) -> None:
    assert CHOICE.number(text) == 2.0


@pytest.mark.parametrize("text", ["2.5", "mine", "nan", "inf"])
def test_what_is_no_choice_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="muscles must be first, second or last"):
        CHOICE.number(text)


def clashing(factor: str, output: str, **changes: Any) -> dict[str, Any]:
    """Return a description with such names."""
    outputs = [{"name": "z", "unit": "m"}, {"name": output, "unit": "m"}]
    return said(factors=[{**FACTOR, "name": factor}], outputs=outputs, **changes)


@pytest.mark.parametrize("name", RESULT_COLUMNS)
def test_no_factor_and_no_output_is_called_as_a_column_of_every_table_is(name: str) -> None:
    words = f"{name} is what a column of every table of results is called: rename this "
    with pytest.raises(DescriptionError) as caught:
        Description.from_json(clashing(name, "y"))
    assert str(caught.value) == f"factors[0].name: {words}factor"
    with pytest.raises(DescriptionError) as caught:
        Description.from_json(clashing("x", name))
    assert str(caught.value) == f"outputs[1].name: {words}output"


@pytest.mark.parametrize(
    ("factor", "output", "deterministic"), [("x", "x", True), ("x", "seed", False)]
)
def test_no_output_is_called_as_a_factor_or_as_the_seed_that_a_study_samples(
    factor: str, output: str, *, deterministic: bool
) -> None:
    with pytest.raises(DescriptionError, match=f"{output} is a factor, too, .* rename") as caught:
        Description.from_json(clashing(factor, output, deterministic=deterministic))
    assert caught.value.field == "outputs[1].name"


def test_a_model_that_was_kept_with_such_names_is_still_shown() -> None:
    kept = Description.from_json(clashing("row", "row"), kept=True)
    assert Description.from_json(kept.as_json(), kept=True) == kept
    assert Description.from_json(clashing("rows", "Row", deterministic=True)).outputs[1] == "Row"
    assert Description.from_json(clashing("x", "seed")).outputs == ("z", "seed")
