"""Each entry of a description that cannot be is told by its place, in one whole sentence."""

from math import inf, nan
from typing import Any

import pytest

from models.entries import DescriptionError, check_names, factor_of, fields_of
from models.factors import Factor

SAID: dict[str, Any] = {"name": "x", "unit": "m", "low": 1, "high": 3.0, "nominal": 2.0}
CHOICE = {**SAID, "low": 0.0, "high": 2.0, "nominal": 1.0, "choices": ["a", "b", "c"]}


def refused(said: Any) -> tuple[str, str]:
    """Return the field and the problem of a factor that is refused."""
    with pytest.raises(DescriptionError) as caught:
        factor_of("f", said)
    assert str(caught.value) == f"{caught.value.field}: {caught.value.problem}"
    return caught.value.field, caught.value.problem


def test_a_factor_is_read_with_what_it_does_not_say() -> None:
    assert factor_of("f", SAID) == Factor(
        name="x", unit="m", low=1.0, high=3.0, nominal=2.0, description=""
    )
    assert type(factor_of("f", SAID).low) is float


@pytest.mark.parametrize(
    ("said", "bounds"),
    [
        ([None, None], (-inf, inf)),
        ([0, None], (0.0, inf)),
        ([None, 4.5], (-inf, 4.5)),
        ([1.0, 3.0], (1.0, 3.0)),
    ],
)
def test_a_bound_that_is_null_is_none(said: Any, bounds: tuple[float, float]) -> None:
    assert factor_of("f", {**SAID, "bounds": said}).bounds == bounds


@pytest.mark.parametrize("said", [[1], [1, 2, 3], [None] * 3, [True, 3.0], ["1", 3.0], []])
def test_bounds_are_two(said: Any) -> None:
    problem = "must be two numbers, or null where there is no bound"
    assert refused({**SAID, "bounds": said}) == ("f.bounds", problem)


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"low": -inf}, "f.low", "must be finite, not -inf"),
        ({"high": nan}, "f.high", "must be finite, not nan"),
        ({"nominal": inf}, "f.nominal", "must be finite, not inf"),
        ({"low": 3.0}, "f.high", "3 must lie above low, 3"),
        ({"low": -1e308, "high": 1e308}, "f.high", "1e+308 must lie above low, -1e+308"),
        ({"bounds": [2.0, 9.0]}, "f.low", "1 lies outside the bounds 2 to 9"),
        ({"bounds": [0.0, 2.5]}, "f.high", "3 lies outside the bounds 0 to 2.5"),
        (
            {"bounds": [0, 3], "nominal": 4.0, "optional": True},
            "f.nominal",
            "4 lies outside the bounds 0 to 3",
        ),
        ({"nominal": 0.5}, "f.nominal", "0.5 lies outside its range, 1 to 3"),
        ({"nominal": 3.5}, "f.nominal", "3.5 lies outside its range, 1 to 3"),
        ({"low": 10**400}, "f.low", "is too large for a number"),
        ({"low": True}, "f.low", "must be a number, not 'True'"),
        ({"low": "x" * 61}, "f.low", f"must be a number, not {'x' * 60!r}"),
        ({"unit": 1}, "f.unit", "must be a text, not '1'"),
        ({"optional": 1}, "f.optional", "must be true or false, not '1'"),
        ({"bounds": {}}, "f.bounds", "must be a list, not '{}'"),
        ({"name": None}, "f.name", "is missing"),
        ({"description": "x" * 501}, "f.description", "must be one line of at most 500 characters"),
        ({"description": "a\nb"}, "f.description", "must be one line of at most 500 characters"),
        ({"choices": [""]}, "f.choices", "must be a list of names"),
        ({"choices": [1]}, "f.choices", "must be a list of names"),
    ],
)
def test_what_cannot_be_is_told_whole(changes: dict[str, Any], field: str, problem: str) -> None:
    assert refused({**SAID, **changes}) == (field, problem)


def test_what_is_at_its_limit_may_be() -> None:
    for nominal in (1.0, 3.0):
        assert factor_of("f", {**SAID, "nominal": nominal}).nominal == nominal
    outside = {**SAID, "nominal": 9.0, "optional": True}
    assert factor_of("f", outside).optional
    assert len(factor_of("f", {**SAID, "description": "x" * 500}).description) == 500


def test_a_choice_goes_from_0_to_its_last_name() -> None:
    assert factor_of("f", CHOICE).choices == ("a", "b", "c")
    problem = "of a choice is the number of its last name, 2"
    for changes in ({"low": 1.0}, {"high": 3.0}):
        assert refused({**CHOICE, **changes}) == ("f.high", problem)


def test_an_entry_that_is_unknown_is_told_with_those_that_are_known() -> None:
    needed, optional = {"name": str}, {"curve": int}
    with pytest.raises(DescriptionError) as caught:
        fields_of("o", {"name": "y", "k" * 90: 1}, needed=needed, optional=optional)
    assert caught.value.field == f"o.{'k' * 80}"
    assert caught.value.problem == "is unknown: expected one of name, curve"
    with pytest.raises(DescriptionError, match=r"^o: must be a table, not list$"):
        fields_of("o", [], needed=needed, optional=optional)
    with pytest.raises(DescriptionError, match=r"^o\.curve: must be a whole number, not '1\.5'$"):
        fields_of("o", {"name": "y", "curve": 1.5}, needed=needed, optional=optional)
    assert fields_of("o", {"name": "y", "curve": None}, needed=needed, optional=optional) == {
        "name": "y"
    }


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        ([], "outputs: a model has at least one output"),
        (["a", "b", "a"], "outputs[2].name: a is listed twice"),
        (
            ["a", "1" * 81],
            f"outputs[1].name: {'1' * 80!r} must be 1 to 64 letters, digits, _, . and -, and begin "
            "with a letter or _",
        ),
    ],
)
def test_names_are_names_and_differ(names: list[str], problem: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        check_names("outputs", names, "output")
    assert str(caught.value) == problem


def test_no_factor_is_called_as_the_seed_is() -> None:
    check_names("outputs", ["seed"], "output")
    with pytest.raises(DescriptionError) as caught:
        check_names("factors", ["x", "seed"], "factor")
    assert str(caught.value) == (
        "factors[1].name: seed is what every evaluation gets besides its factors: choose another "
        "name"
    )
