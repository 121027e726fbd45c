"""Second opinions."""

from dataclasses import replace
from typing import Any

import pytest

from server.logic.fleet.comparisons import (
    ATTEMPTS,
    LEAST,
    Reputation,
    agree,
    concluded,
    difference,
    is_chosen,
    is_comparable,
    put_back,
)
from server.records import Comparison, Lease, Result
from server.states import ComparisonState

ASKED = Comparison(
    id=1,
    row=0,
    position=2,
    state=ComparisonState.LEASED,
    attempts=0,
    lease_id="L",
    first_host="a",
    decided_at=None,
    second_host=None,
    second_worker_id=None,
    outcome=None,
    outputs=None,
    difference=None,
)
LEASE = Lease(
    id="L", fence=1, worker="w2", study="s", state="open", expires_at=9.0, instances=(), host="b"
)


def result(outcome: str = "ok", **outputs: float) -> Result:
    given: Any = outputs or None
    return Result(
        row=0, position=2, outcome=outcome, outputs=given, reason="", state=None, wall_seconds=None
    )


def test_a_stranger_is_trusted_and_every_disagreement_costs() -> None:
    assert Reputation().trust == 1.0
    assert Reputation(agreed=3, disagreed=0).trust == 1.0
    assert Reputation(agreed=0, disagreed=1).trust == 0.5
    assert Reputation(agreed=1, disagreed=3).trust == 0.4


def test_the_wanted_share_of_instances_is_chosen_whoever_asks_and_whenever() -> None:
    chosen = [is_chosen(7, row, position, 0.1) for row in range(500) for position in range(8)]
    assert chosen == [is_chosen(7, row, place, 0.1) for row in range(500) for place in range(8)]
    # Of 4000, the standard deviation of the number is 19.
    assert 320 < sum(chosen) < 480
    assert chosen != [is_chosen(8, row, place, 0.1) for row in range(500) for place in range(8)]


def test_a_share_of_none_chooses_none_and_of_one_all() -> None:
    places = [(row, position) for row in range(50) for position in range(4)]
    assert not any(is_chosen(1, *place, 0.0) for place in places)
    assert all(is_chosen(1, *place, 1.0) for place in places)


def test_the_choice_is_the_same_in_every_version() -> None:
    chosen = [row for row in range(100) if is_chosen(42, row, 3, 0.05)]
    assert chosen == [3, 9, 29, 65, 78]


def test_what_says_more_about_the_machine_is_not_compared() -> None:
    assert is_comparable(result("ok", y=1.0)) and is_comparable(result("diverged"))
    assert not is_comparable(result("crashed")) and not is_comparable(result("lost"))


def test_the_difference_is_the_largest_of_all_outputs_relative_to_the_larger_value() -> None:
    assert difference(result(y=1.0, z=-4.0), result(y=1.0, z=-5.0)) == 0.2
    assert difference(result(y=2.0, z=1.0), result(y=1.0, z=1.0)) == 0.5
    assert difference(result(y=-1.0), result(y=1.0)) == 2.0
    assert difference(result("diverged"), result("diverged")) == 0.0


def test_numbers_that_are_nearly_nothing_are_compared_as_if_they_were_larger() -> None:
    assert difference(result(y=0.0), result(y=LEAST / 10)) == pytest.approx(0.1)


def test_other_outcomes_never_agree() -> None:
    assert difference(result(y=1.0), result("diverged")) is None
    assert not agree(result(y=1.0), result("diverged"), tolerance=9.0)


def test_results_agree_within_the_tolerance_and_at_it() -> None:
    assert agree(result(y=4.0), result(y=5.0), tolerance=0.2)
    assert not agree(result(y=4.0), result(y=5.0), tolerance=0.19)
    assert agree(result(y=4.0), result(y=4.0), tolerance=0.0)


def test_an_opinion_that_fails_to_come_is_asked_for_again_until_it_was_three_times() -> None:
    asked = ASKED
    for count in range(1, ATTEMPTS):
        asked = put_back(asked)
        assert (asked.state, asked.attempts, asked.lease_id) == ("waiting", count, None)
    asked = put_back(replace(asked, lease_id="M"))
    assert (asked.state, asked.attempts, asked.lease_id) == ("abandoned", ATTEMPTS, None)


def test_one_given_back_unharmed_does_not_count() -> None:
    asked = put_back(ASKED, counted=False)
    assert (asked.state, asked.attempts, asked.lease_id) == ("waiting", 0, None)


def test_an_opinion_that_comes_is_kept_with_who_gave_it_and_how_far_it_was() -> None:
    agreed = concluded(ASKED, result(y=4.0), result(y=5.0), LEASE, tolerance=0.2, now=7.0)
    assert agreed == replace(
        ASKED,
        state=ComparisonState.AGREED,
        decided_at=7.0,
        second_host="b",
        second_worker_id="w2",
        outcome="ok",
        outputs={"y": 5.0},
        difference=0.2,
    )
    apart = concluded(ASKED, result(y=4.0), result("diverged"), LEASE, tolerance=0.2, now=7.0)
    assert (apart.state, apart.outcome, apart.difference) == ("disagreed", "diverged", None)
