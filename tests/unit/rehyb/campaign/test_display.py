"""What a campaign shows can be read at a glance."""

import io
import re
from typing import Any

import pytest
from rich.console import Console

from rehyb.campaign.display import LineDisplay, LiveDisplay
from rehyb.campaign.run import View
from rehyb.display import (
    duration,
    failures_in_words,
    indices_table,
    pairs_table,
    progress_in_words,
    spread_table,
    statistic,
)

PROGRESS: dict[str, Any] = {
    "state": "running",
    "instances": 70,
    "ok": 30,
    "failed": 4,
    "failures": {"unstable": 1, "not_settled": 3},
    "rows": 10,
    "rows_complete": 4,
    "results_per_second": 2.04,
    "eta_seconds": 17.6,
    "workers": 2,
}


def interval(value: float | None, low: float | None, high: float | None) -> dict[str, Any]:
    return {"value": value, "low": low, "high": high}


def snapshot(**mu_star: float) -> dict[str, Any]:
    factors = {
        name: {
            "mu_star": interval(value, value / 2, value * 2),
            "sigma": interval(value / 4, None, None),
            "n": 4,
        }
        for name, value in mu_star.items()
    }
    return {"outputs": {"y": {"factors": factors}}}


def view(**changes: Any) -> View:
    given = {
        "phase": 1,
        "title": "screening",
        "output": "y",
        "progress": PROGRESS,
        "snapshot": snapshot(x1=0.5, x2=2.0, x3=1.0),
    }
    return View(**(given | changes))


def drawn(renderable: Any) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(renderable)
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return text


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, "?"), (0.0, "0:00"), (17.6, "0:18"), (61.0, "1:01"), (3725.0, "1:02:05")],
)
def test_time_is_shown_as_on_a_clock(seconds: float | None, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize(
    ("failures", "words"),
    [({}, "none"), ({"lost": 0}, "none"), ({"a": 1, "c": 3, "b": 3}, "b 3, c 3, a 1")],
)
def test_failures_are_named_most_frequent_first(failures: dict[str, int], words: str) -> None:
    assert failures_in_words(failures) == words


def test_progress_is_one_line_with_counts_rate_remaining_time_and_failures() -> None:
    assert progress_in_words(PROGRESS) == (
        "34/70 results, 4/10 rows, 2.0/s, ETA 0:18, 2 workers, failures: not_settled 3, unstable 1"
    )


def test_when_all_is_done_nobody_is_counted_who_left() -> None:
    done = {**PROGRESS, "ok": 70, "failed": 0, "workers": 0, "failures": {}}
    assert "workers" not in progress_in_words(done)


def test_a_line_of_progress_ends_with_why_nobody_works_on_it() -> None:
    waiting = {**PROGRESS, "why_it_waits": "no worker was heard from lately"}
    assert progress_in_words(waiting) == (
        f"{progress_in_words(PROGRESS)}; no worker was heard from lately"
    )


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (None, "-"),
        (interval(None, None, None), "-"),
        (interval(0.5, None, None), "0.5"),
        (interval(0.12345, -0.01, 1.0), "0.123 [-0.01, 1]"),
        (interval(150.0, 119.6, 182.4), "150 [120, 182]"),
        (interval(0.129, 0.1281, 0.1304), "0.129 [0.128, 0.13]"),
    ],
)
def test_an_index_is_shown_with_its_interval_as_soon_as_there_is_one(
    entry: dict[str, Any] | None, words: str
) -> None:
    assert statistic(entry) == words


@pytest.mark.parametrize("value", [0.0188, 9.96, 18.8, 187.6, 1234.5, 1.88e9, -18.8])
def test_no_value_is_shown_outside_of_its_interval(value: float) -> None:
    """An index was `18.8 [19, 19]`."""
    for half in (1e-6, 1e-3, 0.03, 0.5):
        ends = sorted((value * (1.0 - half), value * (1.0 + half)))
        middle, low, high = map(float, re.findall(r"[-+.\de]+", statistic(interval(value, *ends))))
        assert low <= middle <= high
    assert statistic(interval(18.8, 18.78, 18.83)) == "18.8 [18.8, 18.8]"


def test_factors_are_listed_most_influential_first() -> None:
    text = drawn(indices_table(snapshot(x1=0.5, x2=2.0, x3=1.0), "y"))
    assert text.index("x2") < text.index("x3") < text.index("x1")
    assert "2 [1, 4]" in text
    assert "μ*, σ: per whole range" in text


def test_columns_are_headed_by_symbols_and_leave_out_what_others_bound() -> None:
    said = interval(0.5, 0.4, 0.6)
    names = ("independent_total_order", "full_total_order", "full_first_order", "shapley")
    factors = {"x1": dict.fromkeys((*names, "independent_first_order"), said) | {"n": 8}}
    head = drawn(indices_table({"outputs": {"y": {"factors": factors}}}, "y")).split("x1")[0]
    assert head.split()[:7] == ["factor", "Sh", "S", "full", "ST", "independent", "n"]


def test_a_sample_is_shown_as_mean_and_standard_deviation_of_every_output() -> None:
    outputs = {
        "y": {"mean": 1.23456, "sd": 0.5, "n": 64},
        "z": {"mean": None, "sd": None, "n": 0},
    }
    text = drawn(spread_table({"outputs": outputs}))
    assert "standard deviation" in text
    assert [line.split() for line in text.splitlines() if " y " in line or " z " in line] == [
        ["y", "1.235", "0.5", "64"],
        ["z", "-", "-", "0"],
    ]


def test_pairs_are_listed_with_their_interval_the_largest_first() -> None:
    pairs = [
        {"factors": ["x1", "x2"], **interval(0.0, -0.1, 0.1), "n": 8},
        {"factors": ["x1", "x3"], **interval(0.25, 0.2, 0.3), "n": 7},
        {"factors": ["x2", "x3"], **interval(None, None, None), "n": 0},
    ]
    text = drawn(pairs_table(pairs))
    assert text.index("x1 × x3") < text.index("x1 × x2")
    assert "0.25 [0.2, 0.3]" in text and "S of the pair" in text


def test_a_study_without_results_has_an_empty_table() -> None:
    assert "factor" in drawn(indices_table({"outputs": {}}, "y"))


def test_a_log_gets_a_line_with_the_leading_factors_and_what_is_waited_for() -> None:
    log = io.StringIO()
    LineDisplay(log).show(view(waiting="waiting for a worker"))
    (line,) = log.getvalue().splitlines()
    assert line.startswith("phase 1/2: 34/70 results")
    assert "x2 μ* 2 [1, 4], x3 μ* 1 [0.5, 2]; waiting for a worker" in line


def test_a_log_is_not_flooded_but_the_end_of_a_phase_is_always_there() -> None:
    log = io.StringIO()
    display = LineDisplay(log)
    for done in (30, 31, 32):
        display.show(view(progress={**PROGRESS, "ok": done}))
    display.show(view(progress={**PROGRESS, "ok": 66, "state": "complete"}))
    lines = log.getvalue().splitlines()
    assert [line.split()[2] for line in lines] == ["34/70", "70/70"]


def test_a_terminal_shows_progress_and_indices_in_place() -> None:
    terminal = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    with LiveDisplay(terminal) as display:
        display.show(view())
    text = terminal.file.getvalue()  # type: ignore[attr-defined]
    assert "Phase 1 of 2: screening" in text
    assert "34/70 results" in text
    assert "2 [1, 4]" in text


def test_a_terminal_warns_of_failures_that_depend_on_the_factors() -> None:
    terminal = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    failure = {"depends_on_factors": True, "sentence": "failures depend on the factors: x2."}
    with LiveDisplay(terminal) as display:
        display.show(view(snapshot=snapshot(x1=0.5, x2=2.0) | {"failure": failure}))
    assert "failures depend on the factors: x2." in terminal.file.getvalue()  # type: ignore[attr-defined]
