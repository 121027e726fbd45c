"""What `make bench` concludes from what it measured."""

from collections.abc import Iterator
from math import nan

import numpy as np
import pytest

from benchmarks import measuring
from benchmarks.measuring import Target, Throughput, percentile, watch
from benchmarks.sensitivity.coverage_tables import coverage, described
from benchmarks.sensitivity.latency import lags
from benchmarks.service.by_turns import ratio
from benchmarks.service.million import Million
from benchmarks.service.rivals import Rival
from benchmarks.service.table import Round, beside, lines, targets
from benchmarks.simulation.constants import CONSTANTS, held


def target(figure: float, *, at_least: bool) -> Target:
    return Target(what="speed", figure=figure, bound=3.0, unit="times", at_least=at_least)


def throughput(per_second: float) -> Throughput:
    return Throughput(per_second=per_second, cpu_ms=0.5)


@pytest.mark.parametrize(
    ("values", "percent", "expected"),
    [
        ([7.0], 99, 7.0),
        ([3.0, 1.0, 2.0, 4.0], 50, 2.0),
        ([float(i) for i in range(1, 101)], 99, 99.0),
        ([float(i) for i in range(1, 101)], 100, 100.0),
        ([1.0, 2.0], 0, 1.0),
    ],
)
def test_a_percentile_is_one_of_the_values(
    values: list[float], percent: float, expected: float
) -> None:
    assert percentile(values, percent) == expected


def test_nothing_has_no_percentile() -> None:
    with pytest.raises(ValueError, match="nothing"):
        percentile([], 50)


@pytest.mark.parametrize(
    ("figure", "at_least", "met"),
    [
        (3.0, True, True),
        (2.9, True, False),
        (3.0, False, True),
        (3.1, False, False),
        (nan, True, False),
        (nan, False, False),
    ],
)
def test_a_target_is_met_on_the_right_side_of_its_bound(
    figure: float, at_least: bool, met: bool
) -> None:
    found = target(figure, at_least=at_least)
    assert found.met == met
    assert found.line().endswith(": met" if met else ": NOT MET")


def test_a_rate_leaves_out_the_first_and_the_last_tenth(monkeypatch: pytest.MonkeyPatch) -> None:
    # Slow at both ends, ten a second between.
    counts = iter([0, 1, 10, 50, 90, 91, 100])
    times = iter([0.0, 100.0, 200.0, 204.0, 208.0, 300.0, 400.0])
    monkeypatch.setattr(measuring.time, "perf_counter", lambda: next(times))
    monkeypatch.setattr(measuring, "LOOK_SECONDS", 0.0)
    spent: Iterator[float] = iter([1.0, 1.4])
    monkeypatch.setattr(measuring, "cpu_seconds", lambda pids: next(spent))
    found = watch(lambda: next(counts), 100, pids=[])
    assert found.per_second == pytest.approx(10.0)
    assert found.cpu_ms == pytest.approx(5.0)


def test_who_is_slow_is_not_waited_for_longer_than_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts, times = iter([10, 20, 31]), iter([0.0, 9.0, 10.5])
    monkeypatch.setattr(measuring.time, "perf_counter", lambda: next(times))
    monkeypatch.setattr(measuring, "LOOK_SECONDS", 0.0)
    assert watch(lambda: next(counts), 100, pids=[]).per_second == pytest.approx(2.0)


def test_work_that_does_not_end_is_an_error() -> None:
    with pytest.raises(TimeoutError, match="3 of 10"):
        watch(lambda: 3, 10, pids=[], patience=0.0)


def measured(ours: float, **rivals: float) -> Round:
    """Return a round with a safe rival that takes one task at a time, and others."""
    return Round(
        on_sqlite={1: throughput(100.0), 10: throughput(ours)},
        on_postgresql={},
        rivals=[
            Rival(name="safe", batch=1, throughput=throughput(rivals["safe"])),
            Rival(name="forgetful", batch=1, throughput=throughput(9000.0), lacks="what it forgot"),
            Rival(name="slow", batch=1, throughput=throughput(20.0)),
            Rival(name="greedy", batch=100, throughput=throughput(rivals["greedy"])),
        ],
    )


ROUNDS = [
    measured(1500.0, safe=500.0, greedy=3000.0),
    measured(2000.0, safe=500.0, greedy=4000.0),
    measured(800.0, safe=400.0, greedy=1000.0),
]


def test_only_rivals_that_lack_nothing_are_compared_with_and_only_in_their_own_round() -> None:
    assert beside(ROUNDS) == {"any batch": [0.5, 0.5, 0.8], "up to 10": [3.0, 4.0, 2.0]}


def test_of_several_rounds_the_middle_is_held_against_the_targets() -> None:
    strict, first, second, *others = targets(
        ROUNDS,
        {"with work": [0.010] * 99 + [0.3]},
        Million(submit_seconds=0.1, progress_seconds=[0.005], peak_mb=501.0),
    )
    assert (strict.figure, strict.met) == (0.5, False)
    assert (first.figure, first.met) == (3.0, True)
    assert (second.figure, second.met) == (1500.0, False)
    assert [(other.figure, other.met) for other in others] == [
        (10.0, True),
        (5.0, True),
        (0.1, True),
        (501.0, False),
    ]


def test_a_line_of_the_table_has_the_middle_the_least_and_the_most_and_what_a_rival_lacks() -> None:
    _, ours, safe, forgetful, *_ = map(str, lines(ROUNDS))
    assert ours.split()[:7] == ["rehyb,", "SQLite", "10", "1500", "800", "2000", "0.500"]
    assert safe.split() == ["safe", "1", "500", "400", "500", "0.500"]
    assert forgetful.endswith("(what it forgot)")


def test_an_interval_that_is_one_number_holds_the_truth_to_twelve_digits() -> None:
    seeds = np.array([[[2.0], [1.0], [3.0]], [[2.0], [2.1], [3.0]], [[4.0], [4.0], [4.0]]])
    assert coverage(seeds, np.array([2.0])) == pytest.approx(1 / 3)
    assert coverage(seeds, np.array([4.0 + 1e-15])) == pytest.approx(1 / 3)
    assert coverage(seeds, np.array([4.0 + 1e-9])) == 0.0


def test_a_cell_says_mean_range_and_how_much_is_honest() -> None:
    assert described(np.array([0.80, 0.87, 0.90, 0.93])) == "0.875 (0.800 to 0.930)  75%"


def test_results_arrive_at_their_rate_and_every_commit_knows_how_long_it_kept_them() -> None:
    waited = lags(per_second=4000.0, seconds=0.05)
    assert waited and all(0.0 < lag < 5.0 for lag in waited)


def test_every_constant_of_the_table_is_one_number_within_its_uncertainty() -> None:
    for constant in CONSTANTS:
        assert constant.low <= held(constant.name) <= constant.high, constant.name


def test_what_changes_by_turns_is_told_block_by_block() -> None:
    # The machine was three times as slow in the second block and the third.
    times, error = ratio([1.0, 3.0, 3.0], [0.5, 1.5, 1.5])
    assert (times, error) == (pytest.approx(0.5), pytest.approx(0.0))
    times, error = ratio([1.0, 1.0], [0.5, 2.0])
    assert times == pytest.approx(1.0) and error > 0.5
