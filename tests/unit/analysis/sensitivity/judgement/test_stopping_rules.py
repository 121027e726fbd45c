"""What the advisor says, to the word, and where each of its rules begins."""

from dataclasses import replace
from typing import Any

import pytest

from analysis.sensitivity.fewer_runs.limits import LEAST_EXPLAINED
from analysis.sensitivity.judgement.stopping import Goal, advise, next_step
from tests.testbed.snapshots import fitted, interval, snapshot

GOAL = Goal(output="error", target=0.02, up_to=1024)


def test_a_whole_sentence_says_what_is_reached_and_by_whom() -> None:
    reached = advise(snapshot(0.25), "error", target=0.25)
    assert reached is not None and reached.sentence == (
        "Every index of error is within ±0.25: the widest interval, ST of x, has ±0.25."
    )
    assert (reached.target, reached.half_width, reached.more_rows) == (0.25, 0.25, 0)
    hypercube = advise(snapshot(0.04, sampling="latin_hypercube"), "error")
    assert hypercube is not None and hypercube.sentence == (
        "About 900 more rows (3,600 runs) bring error to ±0.02: the widest interval, ST of x, has "
        "±0.04."
    )
    assert hypercube.more_runs == 3600
    full = advise(snapshot(0.08, rows=64), "error")
    assert full is not None and full.sentence.endswith("at a power of two: 1,024 rows in all.")


@pytest.mark.parametrize(
    ("rows", "half", "more"),
    [
        (10, 0.0201, 1),
        (100, 0.0201, 2),
        (100, 0.0282, 99),
        (100, 0.0284, 110),
        (300, 0.04, 900),
        (5000, 0.0373, 13_000),
    ],
)
def test_a_forecast_has_two_digits_and_never_too_few_rows(
    rows: int, half: float, more: int
) -> None:
    advice = advise(snapshot(half, rows=rows), "error")
    assert advice is not None and advice.more_rows == more


def screened(half: float) -> dict[str, Any]:
    """Return a snapshot of a screening of two factors."""
    factors = {"x": {"mu_star": interval(2.0, half)}, "y": {"mu_star": interval(9.0, 0.1)}}
    return {
        "method": "morris",
        "sampling": "owen_blocks",
        "rows_complete": 100,
        "outputs": {"error": {"factors": factors}},
    }


def test_of_effects_nothing_is_said_of_powers_of_two() -> None:
    advice = advise(screened(1.8), "error")
    assert advice is not None and advice.sentence == (
        "About 300 more rows (900 runs) bring error to ±0.9: the widest interval, μ* of x, has "
        "±1.8."
    )


@pytest.mark.parametrize("target", [1e-60, 1e-200, 1e-320])
def test_a_target_out_of_any_reach_needs_more_rows_than_are_counted(target: float) -> None:
    advice = advise(screened(1e100), "error", target)
    assert advice is not None and advice.more_rows == 10**12
    assert advice.sentence == (
        f"More than 1,000,000,000,000 more rows (3,000,000,000,000 runs) bring error to "
        f"±{target:.2g}: the widest interval, μ* of x, has ±1e+100."
    )
    step = next_step(screened(1e100), Goal(output="error", target=target, up_to=300), 100)
    assert step is not None and (step.rows, step.reached) == (128, False)
    shot = snapshot(0.04, rows=100)
    step = next_step(shot, Goal(output="error", target=target, up_to=100), 100)
    assert step is not None and (step.rows, step.reached) == (None, False)


@pytest.mark.parametrize("target", [0.0, -1.0, float("inf"), float("nan")])
def test_a_target_that_is_none_is_named(target: float) -> None:
    with pytest.raises(ValueError) as refused:
        advise(snapshot(0.04), "error", target=target)
    said = f"target is a positive half width of an interval, not {target:g}"
    assert str(refused.value) == said


def believed(half: float, rows: int, *, trusted: bool | None = True) -> dict[str, Any]:
    """Return a snapshot that says how far it can be trusted."""
    found = snapshot(half, rows=rows)
    sentence = "" if trusted else "Do not trust these intervals: why."
    trust = {"runs": 2 * rows, "unseen": 1.5 / rows, "trusted": trusted, "sentence": sentence}
    found["outputs"]["error"]["trust"] = trust
    return found


@pytest.mark.parametrize(
    ("found", "up_to", "rows", "reached", "sentence"),
    [
        (
            believed(0.015, 128),
            5000,
            None,
            True,
            "Every index of error is within ±0.02: the widest interval, ST of x, has ±0.015. What "
            "fewer than 0.012 of the runs show may be unseen.",
        ),
        (
            believed(0.015, 127),
            5000,
            128,
            False,
            "It is extended to 128 rows. Every index of error is within ±0.02: the widest "
            "interval, ST of x, has ±0.015. No study of fewer than 128 rows has reached its "
            "target.",
        ),
        (
            believed(0.015, 300, trusted=False),
            5000,
            512,
            False,
            "It is extended to 512 rows. Intervals of error are within ±0.02, but not to be "
            "trusted: the widest interval, ST of x, has ±0.015. Do not trust these intervals: why.",
        ),
        (
            believed(0.04, 3000),
            3000,
            None,
            False,
            "It has its 3,000 rows, and 3,000 at most were allowed. At most about 9,000 more rows "
            "(36,000 runs) bring error to ±0.02: the widest interval, ST of x, has ±0.04. Sobol "
            "points serve best at a power of two: 16,384 rows in all.",
        ),
        (
            believed(0.04, 3000),
            4000,
            4000,
            False,
            "It is extended to 4,000 rows. At most about 9,000 more rows (36,000 runs) bring error "
            "to ±0.02: the widest interval, ST of x, has ±0.04. Sobol points serve best at a power "
            "of two: 16,384 rows in all.",
        ),
    ],
)
def test_what_a_study_does_next_is_said_with_the_reason(
    found: dict[str, Any], up_to: int, rows: int | None, reached: bool, sentence: str
) -> None:
    goal = Goal(output="error", target=0.02, up_to=up_to)
    step = next_step(found, goal, found["rows_complete"])
    assert step is not None
    assert (step.rows, step.reached, step.sentence) == (rows, reached, sentence)


def test_a_study_that_is_precise_and_not_to_be_trusted_doubles() -> None:
    doubtful = believed(0.015, 300, trusted=False) | {"sampling": "latin_hypercube"}
    step = next_step(doubtful, Goal(output="error", target=0.02, up_to=5000), 300)
    assert step is not None and (step.rows, step.reached) == (600, False)


WHOLE = (
    "A gaussian process fitted to 256 runs explains 99.0% of the variance of error in those held "
    "out; the widest interval, ST of x, has ±"
)


@pytest.mark.parametrize(
    ("found", "goal", "rows", "sentence"),
    [
        (
            fitted(0.019, 256),
            replace(GOAL, target=None),
            None,
            f"{WHOLE}0.019 (wanted: ±0.02). What fewer than 0.012 of the runs show may be unseen.",
        ),
        (
            fitted(0.03, 256),
            GOAL,
            512,
            f"It is extended to 512 rows. {WHOLE}0.03 (wanted: ±0.02).",
        ),
        (
            fitted(0.03, 256),
            replace(GOAL, up_to=256),
            None,
            f"{WHOLE}0.03 (wanted: ±0.02). 256 runs at most were allowed. Indices as precise as "
            "that need a study of method saltelli.",
        ),
        (
            fitted(0.03, 256, explained=0.1),
            replace(GOAL, up_to=400),
            None,
            f"{WHOLE.replace('99.0%', '10.0%')}0.03 (wanted: ±0.02). Indices as precise as that "
            "need a study of method saltelli.",
        ),
    ],
)
def test_a_fitted_function_says_what_it_explains_and_what_comes_next(
    found: dict[str, Any], goal: Goal, rows: int | None, sentence: str
) -> None:
    step = next_step(found, goal, 256)
    assert step is not None and (step.rows, step.sentence) == (rows, sentence)


def test_a_function_that_could_not_be_fitted_is_tried_with_more_runs_if_they_are_few() -> None:
    nothing = fitted(0.03, 128)
    nothing["outputs"]["error"]["surrogate"] = None
    step = next_step(nothing, GOAL, 128)
    assert step is not None
    assert (step.rows, step.sentence) == (
        256,
        "It is extended to 256 rows. After 128 runs error has no indices.",
    )
    at_it = next_step(fitted(0.25, 256), replace(GOAL, target=0.25), 256)
    assert at_it is not None and at_it.reached
    enough = fitted(0.03, 256, explained=LEAST_EXPLAINED)
    step = next_step(enough, GOAL, 256)
    assert step is not None and step.rows == 512
    last = fitted(0.03, 512)
    step = next_step(last, replace(GOAL, up_to=512), 512)
    assert step is not None and step.rows is None and "allowed" not in step.sentence


def with_more(found: int, more: int) -> float:
    """Return the half width from which so many more rows are forecast for ±0.02."""
    return 0.02 * (1.0 + (more - 0.5) / found) ** 0.5


def test_one_row_beyond_a_power_of_two_is_on_the_way_to_the_next() -> None:
    beyond = advise(snapshot(with_more(15, 50), rows=15), "error")
    assert beyond is not None and beyond.sentence.endswith("a power of two: 128 rows in all.")


def test_a_function_is_fitted_to_512_runs_and_to_no_more() -> None:
    all_of_them = advise(fitted(with_more(412, 100), 412), "error")
    assert all_of_them is not None and "512 rows in all" in all_of_them.sentence
    beyond = advise(fitted(with_more(413, 100), 413), "error")
    assert beyond is not None and beyond.sentence.startswith("More than the 512 runs")


def test_a_study_s_own_target_decides() -> None:
    wide, narrow = (Goal(output="error", target=target, up_to=5000) for target in (0.05, 0.01))
    for goal, reached in ((wide, True), (narrow, False)):
        step = next_step(believed(0.04, 300), goal, 300)
        assert step is not None and step.reached is reached


def test_where_nothing_moves_nothing_is_wanted() -> None:
    still = screened(0.1)
    for factor in still["outputs"]["error"]["factors"].values():
        factor["mu_star"] = interval(0.0, 0.1)
    advice = advise(still, "error")
    assert advice is not None and (advice.target, advice.more_rows) == (0.0, 0)


def test_a_snapshot_that_does_not_say_what_may_be_unseen_is_not_added_to() -> None:
    step = next_step(snapshot(0.015), GOAL, 300)
    assert step is not None and step.sentence == (
        "Every index of error is within ±0.02: the widest interval, ST of x, has ±0.015."
    )
