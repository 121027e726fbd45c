"""Whatever a child writes or does not, each instance it was given has one result.

The children here are scripts of a test; `tests/integration/models/test_pool.py` has real ones.
"""

import json
import multiprocessing
import os
from collections.abc import Iterator
from multiprocessing.connection import Connection
from types import SimpleNamespace
from typing import Any

import pytest

from models.running import pool as pools
from models.running.pool import LOAD_SECONDS, Finished, Pool

OK = {"outcome": "ok", "outputs": {}, "reason": "", "state": None, "wall_seconds": 0.1}


class Process:
    """A child that does what a test has it do."""

    every: list["Process"]

    def __init__(self, *, target: Any, args: tuple[Any, ...], daemon: bool) -> None:
        assert daemon and target is pools.evaluate_until_closed
        theirs, bell, self.evaluate, self.parent, self.memory_mb = args
        # The parent closes its copies.
        self._pipe, self._bell = Connection(os.dup(theirs.fileno())), os.dup(bell.fileno())
        self.pid, self.exitcode, self.killed = None, None, False
        self.every.append(self)

    def start(self) -> None:
        pass

    def join(self, seconds: float) -> None:
        assert seconds > 0.0

    def kill(self) -> None:
        self.killed = True
        self.end(-9)

    def given(self) -> list[str]:
        """Return the names of the instances that it has been given."""
        return [one["id"] for one in self._pipe.recv()]

    def says(self, *lines: Any, calls: bool = True) -> None:
        """Write lines, and call for them to be read."""
        for line in lines:
            text = line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n"
            os.write(self._pipe.fileno(), text)
        if calls:
            os.write(self._bell, b"!")

    def end(self, code: int) -> None:
        if self.exitcode is None:
            self.exitcode = code
            self._pipe.close()
            os.close(self._bell)


class Clock(SimpleNamespace):
    """The monotonic clock, which only a test moves."""

    now: float

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(now=100.0)
    monkeypatch.setattr(pools, "time", clock)
    return clock


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Process]]:
    Process.every = []
    context = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Process)
    monkeypatch.setattr(pools.multiprocessing, "get_context", {"spawn": context}.__getitem__)
    yield Process.every
    for child in Process.every:
        child.end(0)


@pytest.fixture
def pool(children: list[Process], clock: Clock) -> Iterator[Pool]:
    pool = Pool(2, 10.0, memory_mb=99)
    yield pool
    pool.kill()


def asked(name: str, **more: Any) -> dict[str, Any]:
    return {"id": name, "model": "m", **more}


def told(done: list[Finished]) -> list[tuple[Any, str, str]]:
    return [(one.ticket, one.result["instance"], one.result["outcome"]) for one in done]


def test_a_child_knows_its_parent_and_what_it_may_take(pool: Pool, children: list[Process]) -> None:
    pool.start(asked("a"), "A")
    (child,) = children
    assert (child.parent, child.memory_mb) == (os.getpid(), 99)
    assert child.evaluate is pools.evaluate_model


def test_an_instance_comes_back_with_its_ticket_and_its_child_takes_the_next(
    pool: Pool, children: list[Process]
) -> None:
    pool.start(asked("a"), "A")
    (child,) = children
    assert child.given() == ["a"]
    assert (pool.free, pool.running) == (1, 1)
    child.says((None, 101.0, None), ("a", 102.0, OK))
    (done,) = pool.wait(0.0)
    assert done == Finished(ticket="A", result={"instance": "a", **OK})
    assert (pool.free, pool.running) == (2, 0)
    pool.start(asked("b"), "B")
    assert (len(children), child.given()) == (1, ["b"])


def test_no_more_is_begun_than_there_are_processes(pool: Pool) -> None:
    pool.start(asked("a"), "A")
    pool.start(asked("b"), "B")
    assert (pool.free, pool.running) == (0, 2)
    with pytest.raises(RuntimeError, match=r"^all 2 processes are busy$"):
        pool.start(asked("c"), "C")


def test_without_work_it_waits_as_long_as_it_may(pool: Pool, clock: Clock) -> None:
    assert pool.wait(3.0) == []
    assert clock.now == 103.0


def test_results_of_a_bundle_are_told_as_they_come_also_in_pieces(
    pool: Pool, children: list[Process]
) -> None:
    pool.start_bundle([(asked(name), name.upper()) for name in "abc"])
    (child,) = children
    assert child.given() == ["a", "b", "c"]
    whole = json.dumps(("b", 103.0, OK)).encode() + b"\n"
    child.says((None, 101.0, None), ("a", 102.0, OK), whole[:9])
    assert told(pool.wait(0.0)) == [("A", "a", "ok")]
    assert (pool.free, pool.running) == (1, 2)
    child.says(whole[9:], ("c", 104.0, OK))
    assert told(pool.wait(0.0)) == [("B", "b", "ok"), ("C", "c", "ok")]
    assert pool.running == 0


def test_of_two_children_each_is_heard(pool: Pool, children: list[Process]) -> None:
    pool.start(asked("a"), "A")
    pool.start(asked("b"), "B")
    children[1].says(("b", 101.0, OK))
    assert told(pool.wait(0.0)) == [("B", "b", "ok")]
    children[0].says(("a", 101.0, OK))
    assert told(pool.wait(0.0)) == [("A", "a", "ok")]
    assert pool.free == 2
    for name, child in zip("cd", children, strict=True):
        pool.start(asked(name), name.upper())
        child.says((name, 101.0, OK))
    assert told(pool.wait(0.0)) == [("C", "c", "ok"), ("D", "d", "ok")]


def test_a_child_that_is_gone_loses_what_it_was_at_and_another_takes_the_rest(
    pool: Pool, children: list[Process], clock: Clock
) -> None:
    pool.start_bundle([(asked(name), name.upper()) for name in "abc"])
    children[0].says(("a", 101.0, OK), calls=False)
    children[0].end(3)
    clock.now = 104.0
    done = pool.wait(0.0)
    assert told(done) == [("A", "a", "ok"), ("B", "b", "crashed")]
    assert done[1].result["reason"] == "the process evaluating it exited with status 3"
    assert done[1].result["wall_seconds"] == 3.0
    assert children[1].given() == ["c"]
    assert (children[1].evaluate, children[1].memory_mb) == (pools.evaluate_model, 99)
    assert (pool.free, pool.running) == (1, 1)


@pytest.mark.parametrize(
    ("code", "how"),
    [(-11, "was ended by SIGSEGV"), (0, "exited with status 0"), (1, "exited with status 1")],
)
def test_a_child_that_is_gone_says_how_it_ended(
    pool: Pool, children: list[Process], code: int, how: str
) -> None:
    pool.start(asked("a"), "A")
    children[0].end(code)
    (done,) = pool.wait(0.0)
    assert done.result["reason"] == f"the process evaluating it {how}"
    assert pool.free == 2


def test_a_child_that_calls_without_a_word_is_at_work(
    pool: Pool, children: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    pool.start(asked("a"), "A")
    monkeypatch.setattr(pools, "wait", lambda bells, seconds: bells)
    assert pool.wait(0.0) == []
    assert not children[0].killed
    # What is sent to it is sent whole.
    assert os.get_blocking(pool._busy[0]._connection.fileno())


def test_cores_are_those_that_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 9)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 3, 5}, raising=False)
    assert pools.available_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert pools.available_cores() == 9
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert pools.available_cores() == 1


def test_a_child_evaluates_an_instance_of_any_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.running.place.evaluate", lambda instance: instance["model"])
    assert pools.evaluate_model(asked("a")) == "m"


@pytest.mark.parametrize(
    "line", [b"no JSON\n", ("x", 101.0, OK), ("b", 101.0, OK), ("a", None, OK), [1], 7]
)
def test_a_child_that_writes_what_is_no_result_is_ended(
    pool: Pool, children: list[Process], line: Any
) -> None:
    pool.start_bundle([(asked("a"), "A"), (asked("b"), "B")])
    children[0].says(line)
    (done,) = pool.wait(0.0)
    assert (done.ticket, done.result["outcome"]) == ("A", "crashed")
    assert done.result["reason"] == "the process evaluating it wrote what is no result"
    assert children[0].killed
    assert children[1].given() == ["b"]


def test_a_result_that_nobody_asked_for_ends_the_child_without_one(
    pool: Pool, children: list[Process]
) -> None:
    pool.start(asked("a"), "A")
    children[0].says(("a", 101.0, OK), ("a", 101.0, OK))
    assert told(pool.wait(0.0)) == [("A", "a", "ok")]
    assert children[0].killed and pool.free == 2


def test_a_time_limit_begins_when_the_model_is_at_hand(
    pool: Pool, children: list[Process], clock: Clock
) -> None:
    pool.start(asked("a"), "A")
    clock.now += 10.0 + LOAD_SECONDS - 0.1
    assert pool.wait(0.0) == []
    children[0].says((None, clock.now, None))
    assert pool.wait(0.0) == []
    clock.now += 9.9
    assert pool.wait(0.0) == []
    clock.now += 0.1
    (done,) = pool.wait(0.0)
    assert told([done]) == [("A", "a", "timed_out")]
    assert done.result["reason"] == "still running after 10 s"
    assert done.result["wall_seconds"] == 10.0
    assert children[0].killed and pool.free == 2


def test_a_model_that_never_loads_is_given_up_a_minute_later(
    pool: Pool, children: list[Process], clock: Clock
) -> None:
    pool.start(asked("a"), "A")
    clock.now += 10.0 + LOAD_SECONDS
    (done,) = pool.wait(0.0)
    assert done.result["reason"] == "still running after 70 s"


def test_each_instance_has_its_own_limit_from_the_end_of_the_one_before(
    pool: Pool, children: list[Process], clock: Clock
) -> None:
    pool.start_bundle(
        [
            (asked("a", time_limit=2.0), "A"),
            (asked("b", time_limit=99.0), "B"),
            (asked("c", model="other", time_limit=0), "C"),
        ]
    )
    children[0].says((None, 100.0, None), ("a", 101.9, OK))
    clock.now = 101.9
    assert told(pool.wait(0.0)) == [("A", "a", "ok")]
    # The pool's own limit is the longest; another model is yet to be loaded.
    clock.now = 111.8
    assert pool.wait(0.0) == []
    children[0].says(("b", 111.8, OK))
    assert told(pool.wait(0.0)) == [("B", "b", "ok")]
    clock.now = 111.8 + 10.0 + LOAD_SECONDS - 0.1
    assert pool.wait(0.0) == []
    clock.now += 0.2
    assert told(pool.wait(0.0)) == [("C", "c", "timed_out")]


def test_it_waits_no_longer_than_until_a_child_is_overdue(
    pool: Pool, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []
    monkeypatch.setattr(pools, "wait", lambda bells, seconds: waits.append(seconds) or [])
    pool.start(asked("a"), "A")
    clock.now += 1.0
    pool.start(asked("b", time_limit=3.0), "B")
    for seconds in (0.5, 99.0):
        assert pool.wait(seconds) == []
    # B's limit and a minute to load.
    assert waits == [0.5, 63.0]
    clock.now += 99.0
    pool.wait(5.0)
    assert waits[2] == 0.0


def test_a_child_that_died_while_idle_costs_no_instance(
    pool: Pool, children: list[Process]
) -> None:
    pool.start(asked("a"), "A")
    children[0].says(("a", 101.0, OK))
    pool.wait(0.0)
    children[0].end(-9)
    pool.start(asked("b"), "B")
    assert children[1].given() == ["b"]
    assert (children[1].evaluate, children[1].memory_mb) == (pools.evaluate_model, 99)
    assert (pool.free, pool.running) == (1, 1)


def test_what_is_killed_is_killed_whether_it_works_or_not(
    pool: Pool, children: list[Process]
) -> None:
    pool.start(asked("a"), "A")
    pool.start(asked("b"), "B")
    children[0].says(("a", 101.0, OK))
    pool.wait(0.0)
    pool.kill()
    assert [child.killed for child in children] == [True, True]
    assert (pool.free, pool.running) == (2, 0)


def test_programs_that_a_model_started_end_with_its_child(
    pool: Pool, children: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[tuple[int, int]] = []

    def kill(pid: int, signal: int) -> None:
        ended.append((pid, signal))
        raise ProcessLookupError

    pool.start(asked("a"), "A")
    children[0].pid = 12345
    monkeypatch.setattr(pools, "descendants", {12345: [7, 8]}.__getitem__)
    monkeypatch.setattr(os, "kill", kill)
    pool.kill()
    assert ended == [(7, 9), (8, 9)]
