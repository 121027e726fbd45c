"""A factor says which values mean something, and which are within its reach."""

from math import inf
from typing import Any

import pytest

from models.factors import Factor, check_bounds, no_factor

SAID: dict[str, Any] = {"name": "mass", "unit": "kg", "description": ""}


def factor(low: float, high: float, nominal: float | None = None, **said: Any) -> Factor:
    nominal = low if nominal is None else nominal
    return Factor(**{**SAID, **said}, low=low, high=high, nominal=nominal)


@pytest.mark.parametrize(
    ("one", "reach"),
    [
        # By its own width, but what is positive is at most halved or doubled.
        (factor(-1.0, 2.0), (-4.0, 5.0)),
        (factor(0.0, 2.0), (-2.0, 4.0)),
        (factor(1.0, 5.0), (0.5, 9.0)),
        (factor(4.0, 4.5), (3.5, 5.0)),
        (factor(1.0, 11.0), (0.5, 21.0)),
        (factor(1.0, 9.0, optional=True), (0.0, 17.0)),
        (factor(-9.0, -1.0, optional=True), (-17.0, 7.0)),
        (factor(-9.0, -8.0, optional=True), (-10.0, 0.0)),
        # Nominal is always within it, and what means nothing never is.
        (factor(4.0, 4.5, nominal=1.0), (1.0, 5.0)),
        (factor(4.0, 4.5, nominal=9.0), (3.5, 9.0)),
        (factor(0.0, 2.0, bounds=(0.0, 3.0)), (0.0, 3.0)),
        (factor(0.0, 2.0, bounds=(0.0, 2.0), choices=("a", "b", "c")), (0.0, 2.0)),
    ],
)
def test_a_reach_ends_a_width_beyond_the_range(one: Factor, reach: tuple[float, float]) -> None:
    assert one.reach == reach
    one.check_reach(*reach)
    for beyond in (reach[0] - 0.1, reach[1] + 0.1):
        with pytest.raises(ValueError, match="far outside"):
            one.check_reach(0.5 * sum(reach), beyond)


@pytest.mark.parametrize(("unit", "words"), [("kg", "9 kg"), ("1", "9")])
def test_what_is_out_of_reach_is_told_with_its_unit(unit: str, words: str) -> None:
    with pytest.raises(ValueError) as caught:
        factor(4.0, 4.5, unit=unit).check_reach(9.0)
    assert str(caught.value) == (
        f"mass is {words}, far outside 4 to 4.5, for which the model was validated: take 3.5 to 5"
    )


@pytest.mark.parametrize(
    ("bounds", "value", "words"),
    [
        ((0.0, inf), -1.0, "mass must be at least 0, not -1.0"),
        ((-inf, 9.0), 10.0, "mass must be at most 9, not 10.0"),
        ((0.0, 9.0), 10.0, "mass must lie between 0 and 9, not 10.0"),
    ],
)
def test_what_means_nothing_is_told_with_what_would(
    bounds: tuple[float, float], value: float, words: str
) -> None:
    one = factor(1.0, 2.0, bounds=bounds)
    check_bounds((one,), {"mass": max(bounds[0], min(bounds[1], value))})
    with pytest.raises(ValueError) as caught:
        check_bounds((one,), {"mass": value})
    assert str(caught.value) == words


def test_a_choice_is_a_whole_number_of_its_names() -> None:
    one = factor(0.0, 2.0, bounds=(0.0, 2.0), choices=("a", "b", "c"))
    # What is not said is nominal.
    for values in ({"mass": 1.0}, {}):
        check_bounds((one,), values)
    with pytest.raises(ValueError) as caught:
        check_bounds((one,), {"mass": 0.5})
    assert str(caught.value) == "mass must be a, b or c, or a number of these from 0, not 0.5"


def test_a_number_is_no_text_unless_it_is_the_name_of_a_choice() -> None:
    assert factor(1.0, 2.0).number(3) == 3.0
    with pytest.raises(ValueError, match=r"^mass must be a number, not '3'$"):
        factor(1.0, 2.0).number("3")


def test_a_factor_that_does_not_exist_is_told_with_those_that_do() -> None:
    assert no_factor("elbow", "g", ["a", "b"]) == "elbow has no factor 'g': it has a, b"
    said = no_factor("elbow", "refitted_muscles", ["a"])
    assert said.startswith("elbow no longer has the factor 'refitted_muscles': write muscles=")
