"""What the advisor promises: rows by the square root law, and a sentence with the numbers."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from analysis.sensitivity.judgement.stopping import Goal, advise, check_target, next_step
from analysis.sensitivity.remarks import remarks
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.snapshots import fitted, snapshot
from tests.testbed.studies import results_of, study_plan


def test_twice_the_precision_takes_four_times_the_rows() -> None:
    advice = advise(snapshot(0.04), "error")
    assert advice is not None
    assert (advice.factor, advice.index, advice.more_rows) == ("x", "total_order", 900)
    assert advice.sentence == (
        "At most about 900 more rows (3,600 runs) bring error to ±0.02: the widest interval, ST of "
        "x, has ±0.04. Sobol points serve best at a power of two: 2,048 rows in all."
    )
    hypercube = advise(snapshot(0.04, sampling="latin_hypercube"), "error")
    assert hypercube is not None and "power of two" not in hypercube.sentence


def test_a_reached_target_needs_nothing_more() -> None:
    advice = advise(snapshot(0.015), "error")
    assert advice is not None
    assert (advice.more_rows, advice.more_runs) == (0, 0)
    assert advice.sentence.startswith("Every index of error is within ±0.02")
    stricter = advise(snapshot(0.015), "error", target=0.005)
    assert stricter is not None and stricter.more_rows == 2400


def test_there_is_no_advice_before_every_index_has_an_interval() -> None:
    for method in ("morris", "saltelli"):
        assert advise(empty_snapshot(study_plan(method, rows=3)), "y") is None


def test_effects_are_wanted_to_a_tenth_of_the_largest() -> None:
    plan = study_plan("morris", rows=30)
    shot = analyse(plan, results_of(plan))
    advice = advise(shot, "y")
    largest = max(f["mu_star"]["value"] for f in shot["outputs"]["y"]["factors"].values())
    assert advice is not None and advice.target == pytest.approx(0.1 * largest)
    nothing = analyse(plan, results_of(plan, lambda x: {"y": 1.0, "z": 1.0}))
    still = advise(nothing, "y")
    assert still is not None and still.more_rows == 0


def test_a_target_is_positive_and_an_output_known() -> None:
    with pytest.raises(ValueError, match="target is a positive half width"):
        advise(snapshot(0.04), "error", target=0.0)
    with pytest.raises(ValueError, match="has no output 'q': it has error"):
        advise(snapshot(0.04), "q")


@pytest.mark.parametrize(
    ("half", "sampling", "rows", "most_rows", "expected"),
    [
        # Already there, or at the end of what is allowed.
        (0.015, "sobol", 300, 5000, (None, True)),
        (0.04, "sobol", 300, 300, (None, False)),
        # To the next power of two, however many more are forecast.
        (0.04, "sobol", 300, 5000, (512, False)),
        (0.04, "sobol_paired", 512, 5000, (1024, False)),
        (0.021, "sobol", 512, 5000, (1024, False)),
        # As forecast, in whole hypercubes of 50 rows, but never more than doubled.
        (0.022, "latin_hypercube", 300, 5000, (400, False)),
        (0.2, "latin_hypercube", 300, 5000, (600, False)),
        # Never beyond the cap.
        (0.2, "latin_hypercube", 300, 420, (420, False)),
        (0.2, "sobol", 300, 420, (420, False)),
    ],
)
def test_a_study_grows_step_by_step_until_it_is_precise_or_at_its_cap(
    half: float, sampling: str, rows: int, most_rows: int, expected: tuple[int | None, bool]
) -> None:
    shot = snapshot(half, sampling=sampling, rows=rows)
    step = next_step(shot, Goal(output="error", target=0.02, up_to=most_rows), rows)
    assert step is not None
    assert (step.rows, step.reached) == expected


def test_a_study_without_intervals_is_not_extended() -> None:
    nothing = empty_snapshot(study_plan("morris", rows=3))
    step = next_step(nothing, Goal(output="y", target=0.1, up_to=99), 0)
    assert step is not None
    assert (step.rows, step.reached) == (None, False)
    assert step.sentence == "After 0 rows y has no intervals. See why its runs failed."


@pytest.mark.parametrize("method", ["saltelli", "shapley", "surrogate"])
def test_an_output_that_nothing_moves_is_said_to_be_the_same_in_every_run(method: str) -> None:
    plan = study_plan(method, rows=256)
    shot = analyse(plan, results_of(plan, lambda x: {"y": 0.1, "z": x["a"]}))
    step = next_step(shot, Goal(output="y", target=0.02, up_to=512), 256)
    assert step is not None and (step.rows, step.reached) == (None, False)
    why = "y is 0.1 in every run: no factor of the study moves it."
    assert step.sentence.endswith(why)
    assert why in remarks(shot, "y")
    assert not any("every run:" in said for said in remarks(shot, "z"))


@pytest.mark.parametrize("method", ["saltelli", "surrogate"])
def test_an_output_without_a_successful_run_is_not_extended_and_refers_to_the_failures(
    method: str,
) -> None:
    plan = study_plan(method, rows=128)
    every = [(row, position) for row in range(128) for position in range(10)]
    shot = analyse(plan, results_of(plan, failed=every))
    step = next_step(shot, Goal(output="y", target=0.02, up_to=128), 128)
    assert step is not None and (step.rows, step.reached) == (None, False)
    assert "See why its runs failed." in step.sentence


def test_a_study_of_too_few_rows_for_any_interval_is_extended_if_it_may_be() -> None:
    plan = study_plan("morris", rows=2)
    shot = analyse(plan, results_of(plan))
    goal = Goal(output="y", target=0.1, up_to=64)
    step = next_step(shot, goal, 2)
    assert step is not None and (step.rows, step.reached) == (4, False)
    assert step.sentence == "It is extended to 4 rows: so few tell no interval of y."
    step = next_step(shot, replace(goal, up_to=2), 2)
    assert step is not None and (step.rows, step.reached) == (None, False)
    assert step.sentence == "After 2 rows y has no intervals. So few tell none."


@pytest.mark.parametrize("method", ["saltelli", "saltelli_second_order", "shapley", "surrogate"])
def test_no_share_of_a_variance_is_wanted_to_half_of_what_it_can_be(method: str) -> None:
    check_target(0.49, method)
    with pytest.raises(ValueError) as refused:
        check_target(0.5, method)
    assert str(refused.value) == (
        "target must be below 0.5, not 0.5: a share of the variance lies between 0 and 1, so ±0.5 "
        "says nothing of it"
    )


@pytest.mark.parametrize("method", ["saltelli", "shapley", "surrogate"])
def test_no_share_of_a_variance_is_wanted_to_less_than_any_study_tells(method: str) -> None:
    check_target(1e-6, method)
    with pytest.raises(ValueError) as refused:
        check_target(9e-7, method)
    assert str(refused.value) == (
        "target must be 1e-06 or more, not 9e-07: no study has rows enough to tell a share of the "
        "variance, between 0 and 1, more precisely"
    )


def test_effects_may_be_wanted_to_any_half_width_and_goals_that_are_set_go_on() -> None:
    check_target(1e6, "morris")
    check_target(1e-300, "morris")
    advice = advise(snapshot(0.04), "error", target=1.5)
    assert advice is not None and advice.more_rows == 0


def test_a_study_is_judged_by_all_its_rows_only() -> None:
    goal = Goal(output="error", target=0.02, up_to=5000)
    assert next_step(snapshot(0.04, rows=300), goal, 301) is None


@pytest.mark.parametrize("sampling", ["sobol", "latin_hypercube"])
def test_followed_to_its_end_a_study_is_as_precise_as_wanted(sampling: str) -> None:
    rows, sizes = 16, list[int]()
    while True:
        plan = study_plan("saltelli", rows=rows, sampling=sampling)
        shot = analyse(plan, results_of(plan))
        step = next_step(shot, Goal(output="y", target=0.15, up_to=1000), rows)
        assert step is not None
        sizes.append(rows)
        if step.rows is None:
            break
        rows = step.rows
    assert step.reached and len(sizes) > 2
    assert step.sentence.startswith("Every index of y is within ±0.15")
    assert all(later <= 2 * earlier or later == 50 for earlier, later in pairwise(sizes))


GOAL = Goal(output="error", target=0.02, up_to=1024)


@pytest.mark.parametrize(
    ("found", "rows", "reached", "words"),
    [
        (fitted(0.001, 128), 256, False, "It is extended to 256 rows"),
        (
            fitted(0.019, 256),
            None,
            True,
            "has ±0.019 (wanted: ±0.02). What fewer than 0.012",
        ),
        (fitted(0.03, 256), 512, False, "It is extended to 512 rows"),
        (fitted(0.019, 256, doubt="Do not."), 512, False, "(wanted: ±0.02). Do not."),
        (fitted(0.3, 256, explained=0.5), None, False, "explains 50.0% of the variance"),
        (fitted(0.03, 512), None, False, "need a study of method saltelli"),
        (fitted(0.3, 128, explained=-2.0), 256, False, "explains 0.0%"),
        (fitted(0.03, 300), 512, False, "It is extended to 512 rows"),
    ],
)
def test_a_study_of_a_fitted_function_goes_from_look_to_look(
    found: dict[str, Any], rows: int | None, reached: bool, words: str
) -> None:
    step = next_step(found, GOAL, found["rows_complete"])
    assert step is not None
    assert (step.rows, step.reached) == (rows, reached)
    assert words in step.sentence


def test_a_fitted_function_is_allowed_no_more_runs_than_asked_and_none_without_values() -> None:
    step = next_step(fitted(0.03, 256), replace(GOAL, up_to=300), 256)
    assert step is not None and step.rows == 300
    step = next_step(fitted(0.03, 300), replace(GOAL, up_to=300), 300)
    assert step is not None and step.rows is None
    assert "300 runs at most were allowed" in step.sentence
    nothing = fitted(0.03, 256)
    nothing["outputs"]["error"]["surrogate"] = None
    step = next_step(nothing, GOAL, 256)
    assert step is not None and (step.rows, step.reached) == (None, False)
    assert step.sentence.startswith("After 256 runs error has no indices.")


def test_no_more_runs_are_forecast_than_a_function_is_fitted_to() -> None:
    advice = advise(fitted(0.1, 256), "error")
    assert advice is not None and advice.sentence.startswith(
        "More than the 512 runs that a function"
    )
