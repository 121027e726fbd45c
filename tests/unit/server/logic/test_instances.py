"""The life of one instance."""

import pytest

from server.logic.instances import BUDGETS, after_attempt, handed_back, settled
from server.records import Instance

HELD = Instance(row=3, position=1, state="leased", lease="L", attempts={})


@pytest.mark.parametrize(("cause", "budget"), list(BUDGETS.items()))
def test_every_cause_has_its_own_budget_and_the_last_attempt_is_the_result(
    cause: str, budget: int
) -> None:
    instance = HELD
    for count in range(1, budget):
        instance, result = after_attempt(instance, cause=cause, reason="why")
        assert (instance.state, instance.lease, instance.attempts) == (
            "pending",
            None,
            {cause: count},
        )
        assert result is None
    instance, result = after_attempt(instance, cause=cause, reason="why")
    assert (instance.state, instance.attempts) == ("done", {cause: budget})
    assert result is not None
    assert (result.row, result.position, result.outcome, result.reason) == (3, 1, cause, "why")
    assert result.outputs is None


def test_budgets_are_the_documented_ones() -> None:
    assert BUDGETS == {"crashed": 3, "timed_out": 3, "invalid": 3, "lost": 5}


def test_one_cause_does_not_use_up_another_s_budget() -> None:
    instance = HELD
    for cause in ["crashed", "crashed", "timed_out", "timed_out", "lost", "lost", "lost", "lost"]:
        instance, result = after_attempt(instance, cause=cause, reason="")
        assert result is None
    assert instance.attempts == {"crashed": 2, "timed_out": 2, "lost": 4}


def test_giving_an_instance_back_unharmed_counts_nothing() -> None:
    instance = handed_back(HELD)
    assert (instance.state, instance.lease, instance.attempts) == ("pending", None, {})


def test_a_settled_instance_is_held_by_nobody() -> None:
    assert (settled(HELD).state, settled(HELD).lease) == ("done", None)
