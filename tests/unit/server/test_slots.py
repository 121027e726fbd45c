"""The life of one instance."""

import pytest

from server.logic.slots import BUDGETS, Slot, after_attempt, handed_back, settled

HELD = Slot(row=3, position=1, state="leased", lease="L", attempts={})


@pytest.mark.parametrize(("cause", "budget"), list(BUDGETS.items()))
def test_every_cause_has_its_own_budget_and_the_last_attempt_is_the_result(
    cause: str, budget: int
) -> None:
    slot = HELD
    for count in range(1, budget):
        slot, result = after_attempt(slot, cause=cause, reason="why")
        assert (slot.state, slot.lease, slot.attempts) == ("pending", None, {cause: count})
        assert result is None
    slot, result = after_attempt(slot, cause=cause, reason="why")
    assert (slot.state, slot.attempts) == ("done", {cause: budget})
    assert result is not None
    assert (result.row, result.position, result.outcome, result.reason) == (3, 1, cause, "why")
    assert result.outputs is None


def test_budgets_are_the_documented_ones() -> None:
    assert BUDGETS == {"crashed": 3, "timed_out": 3, "invalid": 3, "lost": 5}


def test_one_cause_does_not_use_up_another_s_budget() -> None:
    slot = HELD
    for cause in ["crashed", "crashed", "timed_out", "timed_out", "lost", "lost", "lost", "lost"]:
        slot, result = after_attempt(slot, cause=cause, reason="")
        assert result is None
    assert slot.attempts == {"crashed": 2, "timed_out": 2, "lost": 4}


def test_giving_an_instance_back_unharmed_counts_nothing() -> None:
    slot = handed_back(HELD)
    assert (slot.state, slot.lease, slot.attempts) == ("pending", None, {})


def test_a_settled_instance_is_held_by_nobody() -> None:
    assert (settled(HELD).state, settled(HELD).lease) == ("done", None)
