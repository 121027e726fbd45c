"""What a model answers is taken as its description says, or is a failure with a name."""

from typing import Any

import numpy as np
import pytest

from models.description import Description
from models.evaluation import ModelFailure, columns
from tests.unit.models.test_description import SAID

MODEL = Description.from_json(SAID)


def test_an_answer_is_one_number_a_column_in_the_order_of_the_description() -> None:
    found = columns(MODEL, {"path": [1, 2.5, np.float32(3)], "angle": 0.5})
    assert list(found.items()) == [
        ("angle", 0.5),
        ("path[0]", 1.0),
        ("path[1]", 2.5),
        ("path[2]", 3.0),
    ]
    assert columns(MODEL, {"path": np.array([1.0, 2.5, 3.0]), "angle": 0.5}) == found


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        ({"z" * 90: 1.0}, "bad_answer", f"output {'z' * 80!r} is not in its description"),
        ({"angle": ...}, "bad_answer", "output angle is missing"),
        ({"path": [1.0, 2.0]}, "bad_answer", "output path must be a list of 3 numbers, not of 2"),
        ({"path": "123"}, "bad_answer", "output path must be a list of 3 numbers"),
        ({"path": 1.0}, "bad_answer", "output path must be a list of 3 numbers"),
        ({"path": {0, 1, 2}}, "bad_answer", "output path must be a list of 3 numbers"),
        ({"angle": "x" * 70}, "bad_answer", f"output angle must be a number, not {'x' * 60!r}"),
        ({"angle": "1" * 70}, "bad_answer", f"output angle must be a number, not {'1' * 60!r}"),
        ({"angle": True}, "bad_answer", "output angle must be a number, not 'True'"),
        ({"angle": np.array("x")}, "bad_answer", "output angle must be a number, not 'x'"),
        ({"angle": None}, "bad_answer", "output angle must be a number, not 'None'"),
        ({"angle": 10**400}, "bad_answer", f"output angle must be a number, not '1{'0' * 59}'"),
        ({"path": [1, None, 3]}, "bad_answer", "output path[1] must be a number, not 'None'"),
        ({"path": [1, 2, -np.inf]}, "not_finite", "path[2] came out as -inf"),
        ({"angle": np.nan}, "not_finite", "angle came out as nan"),
    ],
)
def test_what_is_no_answer_is_one_sentence(
    change: dict[str, Any], outcome: str, reason: str
) -> None:
    answer = {"angle": 0.5, "path": [1.0, 2.0, 3.0], **change}
    with pytest.raises(ModelFailure) as caught:
        columns(MODEL, {name: value for name, value in answer.items() if value is not ...})
    assert (caught.value.outcome, caught.value.reason) == (outcome, reason)
    assert str(caught.value) == f"{outcome}: {reason}"


@pytest.mark.parametrize("answer", [[1.0], 1.0, None])
def test_an_answer_without_names_is_told_so(answer: Any) -> None:
    with pytest.raises(ModelFailure, match=r"^bad_answer: outputs must be numbers by name, not of"):
        columns(MODEL, answer)


@pytest.mark.parametrize("outcome", ["ok", "", "Diverged", "1st", "x" * 81])
def test_a_failure_has_a_name_of_its_own(outcome: str) -> None:
    with pytest.raises(ValueError, match=f"^outcome '{outcome[:80]}' must be 1 to 40 of a to z"):
        ModelFailure(outcome, "it is so")
    assert ModelFailure("x" * 40, "it is so").outcome == "x" * 40
