"""What the service promises: a result counts once, whoever reads it, whatever dies meanwhile."""

import dataclasses
import json
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.designs import METHODS, SINGLE_POINTS
from analysis.sensitivity import service
from analysis.sensitivity.estimator_state import EstimatorState, StaleStateError
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse, catch_up, follow
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import results_of, study_plan

FAILED = [(0, 1), (4, 0), (7, 3)]


class MemoryLog:
    """A store of one study in memory, with hooks for what may go wrong."""

    def __init__(self, plan: StudyPlan, results: list[LoggedResult]) -> None:
        self.of_study = plan
        self.results = results
        #: How many of the results are in yet.
        self.visible = len(results)
        self.cursor = 0
        self.state: bytes | None = None
        self.snapshot = empty_snapshot(plan)
        self.commits = 0
        #: Cursors at which goals were looked at.
        self.pursued_at: list[int] = []
        #: Called before a commit is decided, and before results are read.
        self.before_commit: Callable[[], None] = lambda: None
        self.before_read: Callable[[], None] = lambda: None
        self.after_goals: Callable[[], None] = lambda: None
        self.lock = threading.Lock()

    def alone(self) -> AbstractContextManager[bool]:
        return nullcontext(True)

    def studies_with_news(self) -> list[str]:
        return [self.of_study.id] if self.cursor < self.visible else []

    def plan(self, study_id: str) -> StudyPlan:
        assert study_id == self.of_study.id
        return self.of_study

    def load(self, study_id: str) -> tuple[int, bytes | None]:
        with self.lock:
            return self.cursor, self.state

    def results_after(self, study_id: str, cursor: int, limit: int) -> list[LoggedResult]:
        self.before_read()
        return self.results[cursor : min(self.visible, cursor + limit)]

    def commit(
        self,
        study_id: str,
        *,
        expected_cursor: int,
        cursor: int,
        state: bytes,
        snapshot: dict[str, Any],
    ) -> bool:
        self.before_commit()
        with self.lock:
            if self.cursor != expected_cursor:
                return False
            self.cursor, self.state, self.snapshot = cursor, state, snapshot
            self.commits += 1
            return True

    def act_on_precision_goals(self) -> None:
        self.pursued_at.append(self.cursor)
        self.after_goals()


def study(method: str, rows: int = 10) -> tuple[MemoryLog, dict[str, Any]]:
    """Return the log of a study and its snapshot computed at one go."""
    plan, results, snapshot = computed(method, rows)
    return MemoryLog(plan, list(results)), snapshot


@cache
def computed(method: str, rows: int) -> tuple[StudyPlan, list[LoggedResult], dict[str, Any]]:
    """Return a study, its results and its snapshot; nobody changes them."""
    # Rows of single points: four times as many, for as many results.
    plan = study_plan(method, 4 * rows if method in SINGLE_POINTS else rows)
    results = results_of(plan, failed=FAILED)
    return plan, results, analyse(plan, results)


def same(snapshot: dict[str, Any], expected: dict[str, Any]) -> bool:
    """Compare every bit."""
    return json.dumps(snapshot) == json.dumps(expected)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_any_order_any_batches_and_any_restarts_leave_the_same_snapshot(
    method: str, data: st.DataObject
) -> None:
    log, expected = study(method)
    order = data.draw(st.permutations(range(len(log.results))))
    # The log's order is that of arrival: who arrives n-th has sequence number n.
    log.results = [
        dataclasses.replace(log.results[old], seq=new + 1) for new, old in enumerate(order)
    ]
    for log.visible in sorted(data.draw(st.sets(st.integers(1, len(order) - 1), max_size=5))):
        catch_up(log, "study")
        assert log.cursor == log.visible
    log.visible = len(order)
    catch_up(log, "study")
    assert same(log.snapshot, expected)


def test_a_service_that_dies_before_its_commit_loses_nothing() -> None:
    log, expected = study("morris")
    log.visible = 17
    catch_up(log, "study")
    log.visible = len(log.results)

    def die() -> None:
        raise ConnectionError("the machine is gone")

    log.before_commit = die
    with pytest.raises(ConnectionError):
        catch_up(log, "study")
    assert log.cursor == 17
    log.before_commit = lambda: None
    assert catch_up(log, "study") == len(log.results) - 17
    assert same(log.snapshot, expected)


@pytest.mark.parametrize("moment", ["before_read", "before_commit"])
@pytest.mark.parametrize("method", METHODS)
def test_whoever_commits_second_is_refused_and_counts_nothing(method: str, moment: str) -> None:
    log, expected = study(method)

    def be_overtaken() -> None:
        setattr(log, moment, lambda: None)
        log.visible = 25
        assert catch_up(log, "study") == 25
        log.visible = len(log.results)

    log.visible = 20
    setattr(log, moment, be_overtaken)
    assert catch_up(log, "study") == 0
    assert log.cursor == 25
    assert catch_up(log, "study") == len(log.results) - 25
    assert same(log.snapshot, expected)


def test_two_services_at_once_leave_the_snapshot_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "BATCH", 3)
    log, expected = study("saltelli", rows=12)
    stop = threading.Event()
    processes = [
        threading.Thread(target=follow, args=(log,), kwargs={"stop": stop, "poll_seconds": 0.001})
        for _ in range(2)
    ]
    for process in processes:
        process.start()
    waiting = threading.Event()
    for _ in range(2000):
        if log.cursor == len(log.results):
            break
        waiting.wait(0.005)
    stop.set()
    for process in processes:
        process.join(timeout=10.0)
        assert not process.is_alive()
    assert same(log.snapshot, expected)


def test_results_read_twice_count_once() -> None:
    log, expected = study("saltelli")
    state = EstimatorState(log.of_study)
    assert state.take(log.results[:32]) == 32
    assert state.take(log.results[10:43]) == 11
    state = EstimatorState.from_bytes(log.of_study, state.to_bytes())
    assert state.take(log.results) == len(log.results) - 43
    assert same(state.snapshot(), expected)


def test_a_caught_up_study_is_not_committed_again() -> None:
    log, _ = study("morris")
    assert catch_up(log, "study") == len(log.results)
    commits = log.commits
    assert catch_up(log, "study") == 0
    assert log.commits == commits


def test_a_long_log_is_committed_batch_by_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "BATCH", 7)
    log, expected = study("morris")
    catch_up(log, "study")
    assert log.commits == 6
    assert same(log.snapshot, expected)


def test_a_study_may_be_extended_while_it_is_analysed() -> None:
    log, _ = study("morris", rows=10)
    catch_up(log, "study")
    longer, expected = study("morris", rows=21)
    log.of_study, log.results, log.visible = longer.of_study, longer.results, longer.visible
    assert catch_up(log, "study") == 11 * 4
    assert same(log.snapshot, expected)


def test_a_state_of_another_format_is_rebuilt_from_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    log, expected = study("saltelli")
    log.visible = 33
    monkeypatch.setattr("analysis.sensitivity.estimator_state.FORMAT", 0)
    catch_up(log, "study")
    monkeypatch.undo()
    log.visible = len(log.results)
    assert catch_up(log, "study") == len(log.results)
    assert same(log.snapshot, expected)


def test_a_state_belongs_to_one_study() -> None:
    log, _ = study("morris")
    state = EstimatorState(log.of_study)
    state.take(log.results)
    other = dataclasses.replace(log.of_study, seed=99)
    with pytest.raises(StaleStateError, match="does not belong to study study as planned"):
        EstimatorState.from_bytes(other, state.to_bytes())


def test_an_output_that_is_missing_is_a_failure_of_that_output() -> None:
    plan = study_plan("morris", rows=4)
    results = results_of(plan)
    results[5] = dataclasses.replace(results[5], outputs={"y": 1.0})
    outputs = analyse(plan, results)["outputs"]
    assert [outputs[name]["n"] for name in ("y", "z")] == [16, 15]
    assert [f["n"] for f in outputs["z"]["factors"].values()] == [3, 4, 4]
    assert [f["n"] for f in outputs["y"]["factors"].values()] == [4, 4, 4]


@pytest.mark.parametrize("value", [1.1e100, -1e200, float("inf")])
def test_a_value_too_large_for_indices_is_a_failed_run_that_is_counted(value: float) -> None:
    plan = study_plan("morris", rows=4)
    results = results_of(plan)
    results[9] = dataclasses.replace(results[9], outputs={"y": 1.0, "z": value})
    snapshot = analyse(plan, results)
    assert snapshot["evaluations"] == {"ok": 15, "out_of_range": 1}
    assert (snapshot["failure"]["failed"], snapshot["failure"]["mean"]) == (1, 1 / 16)
    assert [snapshot["outputs"][name]["n"] for name in ("y", "z")] == [15, 15]
    assert snapshot["failure"]["sentence"].startswith("1 of 16 runs failed (6.2%)")


@pytest.mark.parametrize(("row", "position"), [(-1, 0), (10, 0), (0, 4), (0, -1)])
def test_a_result_of_no_place_in_the_study_is_refused(row: int, position: int) -> None:
    log, _ = study("morris")
    stray = dataclasses.replace(log.results[0], row=row, position=position)
    with pytest.raises(ValueError, match=f"is at row {row}, position {position}"):
        EstimatorState(log.of_study).take([stray])


def test_following_ends_when_asked_even_amid_work() -> None:
    log, _ = study("morris")
    stop = threading.Event()
    log.before_commit = stop.set
    follow(log, stop=stop, poll_seconds=60.0)
    assert log.cursor == len(log.results)


def test_goals_are_pursued_after_what_is_new_was_taken_in() -> None:
    log, _ = study("morris")
    stop = threading.Event()
    log.after_goals = stop.set
    follow(log, stop=stop, poll_seconds=60.0)
    assert log.pursued_at == [len(log.results)]


def test_a_store_that_goes_is_waited_for_with_growing_pauses_and_told_of_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    log, expected = study("morris")
    stop, failures = Pauses(), 12

    def go() -> None:
        if len(stop.pauses) < failures:
            raise ConnectionError("gone")

    log.before_commit = go
    log.after_goals = stop.set
    follow(log, stop=stop, why_away=lambda error: f"it is {error}")
    assert same(log.snapshot, expected)
    assert stop.pauses[:failures] == [1.0, 2.0, 4.0, *[8.0] * 9]
    assert stop.pauses[failures:] == [0.5]
    assert [record.message for record in caplog.records] == [
        "the database is away, and waited for: it is gone",
        "the database is back",
    ]


def test_an_error_that_is_not_about_the_connection_ends_the_service() -> None:
    log, _ = study("morris")

    def fail() -> None:
        raise ConnectionError("another error")

    log.before_commit = fail
    with pytest.raises(ConnectionError, match="another error"):
        follow(log, stop=Pauses(), why_away=lambda error: None)


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("float division by zero"),
        OverflowError(34, "Numerical result out of range"),
        KeyError("y"),
        TypeError("float, not None"),
        MemoryError(),
        RecursionError("too deep"),
    ],
)
def test_a_study_that_cannot_be_computed_stops_no_other_and_is_told_of_once(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    log, _ = study("morris")
    stop, looks = Pauses(), []

    def fail() -> None:
        raise error

    def count() -> None:
        looks.append(1)
        if len(looks) == 3:
            stop.set()

    log.before_commit, log.after_goals = fail, count
    follow(log, stop=stop)
    assert log.cursor == 0 and len(looks) == 3
    (told,) = caplog.records
    assert "has no indices" in told.message


class Pauses(threading.Event):
    """An event that nobody waits for, and for how long they would have."""

    def __init__(self) -> None:
        super().__init__()
        self.pauses: list[float] = []

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.pauses.append(timeout)
        return self.is_set()
