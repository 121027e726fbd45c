"""Curves: how their points are named, sent and stored."""

import json
from math import pi

import pytest

from models.curves import (
    Curve,
    CurveError,
    columns_of,
    folded,
    names_of,
    packed,
    unfolded,
    unpacked,
)

TORQUE = {"torque": Curve(points=3, over="phase")}
NUMBERS = {"error": 1.5, "torque[0]": 0.1, "torque[1]": -2e-300, "torque[2]": pi, "peak": 3.0}


def test_a_curve_travels_as_one_list_and_comes_back_in_its_place() -> None:
    sent = folded(NUMBERS, TORQUE)
    assert sent == {"error": 1.5, "torque": [0.1, -2e-300, pi], "peak": 3.0}
    assert list(unfolded(json.loads(json.dumps(sent)), TORQUE).items()) == list(NUMBERS.items())


def test_a_curve_is_named_once_where_its_points_stand() -> None:
    assert names_of(NUMBERS, TORQUE) == ["error", "torque", "peak"]
    assert columns_of(["error", "torque", "peak"], TORQUE) == tuple(NUMBERS)


def test_outputs_without_curves_stay_as_they_are() -> None:
    assert folded({"y": 1.0}, {}) == unfolded({"y": 1.0}, {}) == packed({"y": 1.0}) == {"y": 1.0}


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ([1.0, 2.0], "output torque must have 3 points, not 2"),
        ([1.0] * 4, "output torque must have 3 points, not 4"),
        (1.0, "output torque must be a list of 3 numbers"),
        ("123", "output torque must be a list of 3 numbers"),
        ({"0": 1.0}, "output torque must be a list of 3 numbers"),
    ],
)
def test_a_curve_of_wrong_length_is_one_sentence(said: object, sentence: str) -> None:
    with pytest.raises(CurveError) as caught:
        unfolded({"torque": said}, TORQUE)
    assert str(caught.value) == sentence


def test_a_stored_curve_is_one_text_and_loses_no_bit() -> None:
    stored = packed(NUMBERS)
    assert packed({"torque[0]": 1.0, "torque[1]": 2.0})["torque"].startswith("f8:")
    assert list(stored) == ["error", "torque", "peak"] and isinstance(stored["torque"], str)
    assert list(unpacked(json.loads(json.dumps(stored))).items()) == list(NUMBERS.items())


@pytest.mark.parametrize(
    "outputs",
    [
        {"torque[0]": 1.0},
        {"torque[1]": 1.0, "torque[0]": 2.0},
        {"torque[0]": 1.0, "force[1]": 2.0},
        {"torque[0]": 1.0, "torque[2]": 2.0},
        {},
    ],
)
def test_numbers_that_only_look_like_points_are_stored_as_numbers(
    outputs: dict[str, float],
) -> None:
    assert packed(outputs) == outputs
    assert unpacked(packed(outputs)) == outputs


def test_what_is_stored_takes_a_third_of_what_is_named_point_by_point() -> None:
    outputs = {f"torque_over_phase[{i}]": i * pi for i in range(101)}
    assert len(json.dumps(packed(outputs))) < len(json.dumps(outputs)) / 3


def test_a_text_that_is_no_curve_is_one_sentence() -> None:
    (stored,) = packed({"torque[0]": 1.0, "torque[1]": 2.0}).values()
    for text in ("f8:not base64", "f8:AAAA", f"{stored}!"):
        with pytest.raises(CurveError, match="output torque is stored as no curve"):
            unpacked({"torque": text})


def test_an_axis_is_even_and_ends_where_it_says() -> None:
    axis = Curve(points=101, over="time", unit="s", low=0.1, high=0.7).axis()
    assert (len(axis), axis[0], axis[-1]) == (101, 0.1, 0.7)
    assert axis[50] == pytest.approx(0.4) and axis[99] == pytest.approx(0.694)
    assert Curve(points=1, over="time").axis() == [0.0]
    curve = Curve(points=7, over="angle", unit="rad", low=-1.0, high=2.0)
    assert Curve.from_json(json.loads(json.dumps(curve.as_json()))) == curve
