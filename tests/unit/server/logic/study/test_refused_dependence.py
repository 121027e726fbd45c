"""Requests that say how factors depend on each other in words that are none here."""

from typing import Any

import pytest

from server.errors import InvalidStudyError
from server.logic.study.requests import refuse_dependence

SAID = (
    ": how factors depend on each other is said by the study's correlations, as "
    '[["a", "b", 0.6]], and by its correlation_kind, rank or linear'
)


@pytest.mark.parametrize(
    ("body", "pointer", "key"),
    [
        ({"rows": 1, "copula": "clayton"}, "/copula", "copula"),
        ({"Correlation": []}, "/Correlation", "Correlation"),
        ({"covariance": []}, "/covariance", "covariance"),
        ({"depends/on": 1}, "/depends~1on", "depends/on"),
        ({"joint~law": 1}, "/joint~0law", "joint~law"),
        (
            {"factors": [{"name": "a"}, {"name": "b", "correlations": []}]},
            "/factors/1/correlations",
            "correlations",
        ),
        (
            {"factors": ["a", {"distribution": {"kind": "normal", "dependence": 1}}]},
            "/factors/1/distribution/dependence",
            "dependence",
        ),
    ],
)
def test_the_first_such_key_is_named_with_what_is_right(body: Any, pointer: str, key: str) -> None:
    with pytest.raises(InvalidStudyError) as refused:
        refuse_dependence(body)
    assert (refused.value.pointer, str(refused.value)) == (pointer, key + SAID)


@pytest.mark.parametrize(
    "body",
    [
        {"correlations": [["a", "b", 0.6]], "correlation_kind": "rank"},
        {"factors": [{"name": "a", "distribution": {"kind": "normal"}}, None]},
        {"factors": {"name": "correlations"}},
        {"name": "copula", 3: "joint"},
        {"factors": [{"distribution": ["joint"]}]},
        ["copula"],
        None,
    ],
)
def test_anything_else_is_left_to_who_reads_the_request(body: Any) -> None:
    refuse_dependence(body)
