"""The life of one instance."""

from dataclasses import replace

import pytest

from server.logic.study.instances import (
    BUDGETS,
    after_attempt,
    handed_back,
    held,
    may_try,
    reopened,
    unheard,
    with_result,
)
from server.records import Instance

HELD = Instance(row=3, position=1, state="leased", lease="L", attempts={})
#: As HELD, after two attempts.
TRIED = replace(HELD, attempts={"lost": 2}, host_class="c", avoid="a", hosts={"lost": ("a", "b")})


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


def test_what_a_worker_never_heard_of_uses_up_no_budget_however_often() -> None:
    instance = HELD
    for count in range(1, 30):
        instance = unheard(instance, "h")
        assert (instance.state, instance.lease) == ("pending", None)
        assert (instance.attempts, instance.hosts) == ({"unheard": count}, {"unheard": ("h",)})
    assert not may_try(instance, "h", {"h", "other"})


def test_a_settled_instance_is_held_by_nobody() -> None:
    assert (with_result(HELD).state, with_result(HELD).lease) == ("done", None)


def test_a_reopened_instance_is_as_before_it_was_handed_out() -> None:
    done = replace(TRIED, state="done")
    bound = reopened(done, unbound=False)
    assert bound == Instance(
        row=3, position=1, state="pending", lease=None, attempts={}, host_class="c"
    )
    assert reopened(done, unbound=True).host_class is None


def test_what_is_settled_keeps_what_was_tried_and_where() -> None:
    assert with_result(TRIED) == replace(TRIED, state="done", lease=None)


def test_a_lease_holds_what_names_it() -> None:
    other = replace(HELD, position=2, lease="M")
    free = replace(HELD, position=3, lease=None)
    all_of_them = {(one.row, one.position): one for one in (HELD, other, free)}
    assert held(all_of_them, lease="L") == {(3, 1): HELD}


@pytest.mark.parametrize(
    ("hosts", "avoid", "host", "at_work", "may"),
    [
        # It goes to a host that has not tried it ...
        ({}, None, "a", ("a",), True),
        ({"lost": ("b",)}, "b", "a", ("a", "b"), True),
        # ... and to one that has only when no other is left that has not,
        ({"lost": ("a",)}, "a", "a", ("a", "b"), False),
        ({"lost": ("a", "b")}, "b", "a", ("a", "b"), True),
        ({"lost": ("a",), "crashed": ("b",)}, "b", "a", ("a", "b", "c"), False),
        # but not to the last one unless it is alone,
        ({"lost": ("a", "b")}, "a", "a", ("a", "b"), False),
        ({"lost": ("a",)}, "a", "a", ("a",), True),
        ({"lost": ("a",)}, "a", "a", (), True),
        # and a host that only is to be avoided counts as having tried it.
        ({}, "a", "a", ("a", "b"), False),
        ({}, "a", "a", ("a",), True),
    ],
)
def test_an_instance_goes_to_fresh_hosts_first_and_then_to_any_but_the_last(
    hosts: dict[str, tuple[str, ...]],
    avoid: str | None,
    host: str,
    at_work: tuple[str, ...],
    may: bool,
) -> None:
    assert may_try(replace(HELD, hosts=hosts, avoid=avoid), host, at_work) is may


def test_each_return_is_noted_with_its_host_once() -> None:
    counted, _ = after_attempt(HELD, cause="lost", reason="", host="a", at_work=("a", "b"))
    counted, _ = after_attempt(counted, cause="lost", reason="", host="a", at_work=("a", "b"))
    counted, _ = after_attempt(counted, cause="crashed", reason="", host="b", at_work=("a", "b"))
    assert counted.hosts == {"lost": ("a",), "crashed": ("b",)}
    assert (counted.avoid, counted.attempts) == ("b", {"lost": 2, "crashed": 1})
    counted, _ = after_attempt(counted, cause="lost", reason="")
    assert (counted.avoid, counted.hosts) == (None, {"lost": ("a",), "crashed": ("b",)})


@pytest.mark.parametrize(
    ("hosts", "at_work", "last"),
    [
        # As many hosts as the budget have had it.
        (("a", "b", "c"), ("a", "b", "c", "d"), 3),
        # No other host is at work.
        (("a", "a", "a"), ("a",), 3),
        # Others are, but it never gets there: twice the budget, and no more.
        (("a",) * 6, ("a", "b"), 6),
        (("a", "b", "a", "b", "a", "b"), ("a", "b", "c"), 6),
    ],
)
def test_a_budget_is_spent_on_as_many_hosts_or_on_those_there_are(
    hosts: tuple[str, ...], at_work: tuple[str, ...], last: int
) -> None:
    instance = HELD
    for count, host in enumerate(hosts, 1):
        instance, final = after_attempt(
            instance,
            cause="crashed",
            reason="core dumped",
            host=host,
            at_work=at_work,
            state={"t": count},
            wall_seconds=2.0,
        )
        assert (final is not None) is (count == last)
    assert final is not None
    assert (final.state, final.wall_seconds, final.reason) == ({"t": last}, 2.0, "core dumped")
    assert instance.state == "done"


def test_an_attempt_on_no_known_host_names_none() -> None:
    counted, _ = after_attempt(HELD, cause="lost", reason="")
    assert counted.hosts == {}
