"""Which reports no study takes, and what is said of them."""

from collections.abc import Callable
from math import inf
from typing import Any

import pytest

from models.evaluation import ModelFailure
from server.logic.fleet.verdicts import Report, fault_in
from server.logic.study.instances import RESERVED, STANDINGS

Reporting = Callable[..., Report]


def _nested(levels: int) -> dict[str, Any]:
    state: dict[str, Any] = {}
    for _ in range(levels):
        state = {"inside": state}
    return state


def test_a_failure_may_have_any_name_that_a_model_may_give_it(report: Reporting) -> None:
    for name in ("diverged", "step2_failed", "e" * 40):
        assert fault_in(report("i", outcome=name), ["y"]) is None
        assert ModelFailure(name, "").outcome == name


@pytest.mark.parametrize("name", ["ok", *STANDINGS, *RESERVED])
def test_no_model_may_name_a_failure_that_no_coordinator_takes(name: str) -> None:
    with pytest.raises(ValueError, match="none of"):
        ModelFailure(name, "")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"outcome": "Bad"}, "the outcome must be 'ok' or a failure in 1 to 40 of a to z"),
        ({"outcome": "a" * 300}, "the outcome must be 'ok' or a failure in 1 to 40 of a to z"),
        ({"outcome": ["ok"]}, "the outcome must be 'ok' or a failure in 1 to 40 of a to z"),
        ({"outcome": "lost"}, "only the coordinator concludes 'lost'"),
        ({"outcome": "pending"}, "'pending' is where an instance stands, and no outcome"),
        ({"outcome": "quarantined"}, "'quarantined' is where an instance stands, and no outcome"),
        ({"wall_seconds": -1e-9}, "wall_seconds must be a number from 0 to 1e+09, or null"),
        ({"wall_seconds": 1e308}, "wall_seconds must be a number from 0 to 1e+09, or null"),
        ({"reason": 5}, "reason must be text, or null"),
        ({"outcome": "slipped", "reason": ["because"]}, "reason must be text, or null"),
        ({"state": [1]}, "state must be an object, or null"),
        ({"state": _nested(33)}, "the state is nested more than 32 deep"),
        ({"state": {"q": inf}}, "the state holds a number that is not finite: send null"),
        ({"state": {"q": [1] * 100_000}}, "the state holds more than 100,000 values and char"),
        ({"state": {"q": [["a" * 50_000]] * 2}}, "the state holds more than 100,000 values"),
        ({"state": {"a" * 100_000: 1}}, "the state holds more than 100,000 values and char"),
        ({"outputs": [1.0]}, "outputs must be an object: numbers by name"),
        ({"outputs": ""}, "outputs must be an object: numbers by name"),
        ({"outputs": None}, "output y is missing"),
        ({"outputs": {"y": "a"}}, "output y must be a finite number"),
        ({"outputs": {"y": -1.1e100}}, "output y must be within ±1e+100"),
    ],
)
def test_a_fault_is_said_in_a_sentence(
    changes: dict[str, Any], says: str, report: Reporting
) -> None:
    fault = fault_in(report("i", **changes), ["y"])
    assert fault is not None and fault.startswith(says)


@pytest.mark.parametrize(
    "changes",
    [
        {"outcome": "d" * 40},
        {"outcome": "a_b"},
        {"wall_seconds": 0},
        {"wall_seconds": None},
        {"state": _nested(31)},
        {"state": {"q": [1] * 99_998}},
        {"outputs": {"y": 1e100}},
        {"outputs": {"y": -1e100}},
    ],
)
def test_what_is_at_the_edge_is_taken(changes: dict[str, Any], report: Reporting) -> None:
    assert fault_in(report("i", **changes), ["y"]) is None
