"""A child process writes one result for each instance, as JSON that any coordinator takes."""

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.evaluation import Evaluation, ModelFailure
from models.running import child
from models.running.child import failed, needed
from models.running.outcomes import Outcome


class Pipes:
    """What a child writes to its parent: results, and calls to read them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.results_in, self.results_out = os.pipe()
        self.bell_in, self.bell_out = os.pipe()
        #: What the child's clock shows.
        self.now = 100.0
        self.loaded: list[Any] = []
        monkeypatch.setattr(child, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(child, "_AT_HAND", set())
        monkeypatch.setattr("models.running.place.load", self._load)

    def _load(self, instance: Mapping[str, Any]) -> None:
        self.loaded.append(instance["model"])
        raise ModelFailure("bad_model", "its evaluation says so")

    def work(
        self, evaluate: Callable[[Mapping[str, Any]], Evaluation], *bundle: dict[str, Any]
    ) -> tuple[list[Any], int]:
        """Return what comes of instances: the lines, and how often the parent is called."""
        child._work_through(bundle, evaluate, self.results_out, self.bell_out)
        lines = os.read(self.results_in, 1_000_000).decode()
        assert lines.endswith("\n")
        return [json.loads(line) for line in lines.splitlines()], len(os.read(self.bell_in, 1000))

    def close(self) -> None:
        for one in (self.results_in, self.results_out, self.bell_in, self.bell_out):
            os.close(one)


@pytest.fixture
def pipes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipes]:
    made = Pipes(monkeypatch)
    yield made
    made.close()


def double(instance: Mapping[str, Any]) -> Evaluation:
    y = 2.0 * instance["x"]
    return Evaluation(outcome="ok", outputs={"y": y}, wall_seconds=0.5)


def asked(name: str, x: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"id": name, "model": "m", "x": x, **more}


def only(pipes: Pipes, evaluate: Callable[[Mapping[str, Any]], Evaluation], **more: Any) -> Any:
    """Return the report on one instance."""
    lines, _ = pipes.work(evaluate, asked("a", **more))
    return lines[-1][2]


def test_a_model_is_said_to_be_at_hand_once_and_then_each_instance_has_its_line(
    pipes: Pipes,
) -> None:
    lines, calls = pipes.work(double, asked("a"), asked("b", 2.0), asked("c", model="other"))
    assert [(name, when) for name, when, _ in lines] == [
        (None, 100.0),
        ("a", 100.0),
        ("b", 100.0),
        (None, 100.0),
        ("c", 100.0),
    ]
    assert [report and report["outputs"]["y"] for _, _, report in lines] == [None, 2, 4, None, 2]
    # What is wrong with a model its evaluation says.
    assert pipes.loaded == ["m", "other"]
    assert calls == 1


def test_the_parent_is_called_when_there_is_enough_to_read_or_time_has_passed(
    pipes: Pipes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(instance: Mapping[str, Any]) -> Evaluation:
        pipes.now += instance["takes"]
        return double(instance)

    monkeypatch.setattr(child, "CALL_SECONDS", 0.25)
    takes = [0.125, 0.125, 0.125, 0.25, 0.125]
    lines, calls = pipes.work(slow, *(asked(f"{i}", takes=one) for i, one in enumerate(takes)))
    # After a quarter of a second, again after more than one, and at the end.
    assert calls == 3
    assert [when for name, when, _ in lines if name] == [100.125, 100.25, 100.375, 100.625, 100.75]
    length = len(json.dumps(("0", pipes.now, lines[-1][2])) + "\n")
    # After two lines, after four and at the end; after three and at the end.
    for size, instances, calls in ((2 * length, 5, 3), (2 * length + 1, 6, 2)):
        monkeypatch.setattr(child, "CALL_BYTES", size)
        assert pipes.work(double, *(asked(f"{i}") for i in range(instances)))[1] == calls


def test_a_success_is_told_whole(pipes: Pipes) -> None:
    assert only(pipes, double) == {
        "outcome": "ok",
        "outputs": {"y": 2.0},
        "reason": "",
        "state": None,
        "wall_seconds": 0.5,
    }


def test_points_of_a_curve_that_is_asked_for_are_one_list(pipes: Pipes) -> None:
    def evaluate(_: Mapping[str, Any]) -> Evaluation:
        outputs = {"t[0]": np.float32(1.0), "t[1]": 2.0}
        return Evaluation(outcome="ok", outputs=outputs, wall_seconds=0.0)

    curves = {"t": {"points": 2, "over": "time"}}
    assert only(pipes, evaluate, curves=curves)["outputs"] == {"t": [1.0, 2.0]}
    assert only(pipes, evaluate)["outputs"] == {"t[0]": 1.0, "t[1]": 2.0}


def test_a_state_is_told_as_plain_json(pipes: Pipes) -> None:
    class Odd:
        def __str__(self) -> str:
            return "odd"

    state = {
        "time": nan,
        "qpos": np.array([0.5, inf]),
        "steps": np.int64(3),
        1: (True, None, "text", 0.25),
        "odd": Odd(),
    }

    def evaluate(_: Mapping[str, Any]) -> Evaluation:
        return Evaluation(
            outcome="diverged", outputs={}, reason="far away", state=state, wall_seconds=0.25
        )

    assert only(pipes, evaluate) == {
        "outcome": "diverged",
        "outputs": {},
        "reason": "far away",
        "state": {
            "time": None,
            "qpos": [0.5, None],
            "steps": 3,
            "1": [True, None, "text", 0.25],
            "odd": "odd",
        },
        "wall_seconds": 0.25,
    }


def test_a_failure_that_the_model_names_is_told_with_its_state_and_time(pipes: Pipes) -> None:
    def evaluate(_: Mapping[str, Any]) -> Evaluation:
        pipes.now += 0.25
        raise ModelFailure("diverged", "far away", {"time": inf})

    assert only(pipes, evaluate) == {
        "outcome": "diverged",
        "outputs": {},
        "reason": "far away",
        "state": {"time": None},
        "wall_seconds": 0.25,
    }


def test_any_other_error_is_a_crash_with_its_traceback(pipes: Pipes) -> None:
    def evaluate(_: Mapping[str, Any]) -> Evaluation:
        pipes.now += 0.25
        raise ZeroDivisionError("no length")

    report = only(pipes, evaluate)
    assert "in evaluate" in report.pop("state")["traceback"]
    assert report == {
        "outcome": "crashed",
        "outputs": {},
        "reason": "ZeroDivisionError: no length",
        "wall_seconds": 0.25,
    }


def test_an_output_that_is_not_finite_is_a_failure_that_names_it(pipes: Pipes) -> None:
    def evaluate(_: Mapping[str, Any]) -> Evaluation:
        outputs, state = {"x": 1.0, "y": -inf}, {"time": 0.5}
        return Evaluation(outcome="ok", outputs=outputs, state=state, wall_seconds=0.25)

    assert only(pipes, evaluate) == {
        "outcome": "not_finite",
        "outputs": {},
        "reason": "y came out as -inf",
        "state": {"time": 0.5},
        "wall_seconds": 0.25,
    }


def test_a_result_is_written_whole_however_little_a_pipe_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken: list[bytes] = []

    def write(_: int, text: bytes) -> int:
        taken.append(text[:3])
        return len(taken[-1])

    monkeypatch.setattr(child, "os", SimpleNamespace(write=write))
    child._write(7, b"a result\n")
    assert taken == [b"a r", b"esu", b"lt\n"]


class System:
    """What a child asks of its operating system when it begins."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        self.environ: dict[str, str] = {}

        def noted(what: str) -> Callable[..., None]:
            return lambda *said: self.asked.append((what, *said))

        kernel = SimpleNamespace(nice=noted("nice"), environ=self.environ, write=os.write)
        limits = SimpleNamespace(setrlimit=noted("limit"), RLIMIT_DATA="data")
        signals = SimpleNamespace(
            signal=noted("signal"), SIG_IGN=1, SIGINT=2, SIGTERM=15, SIGKILL=9
        )
        monkeypatch.setattr(child, "os", kernel)
        monkeypatch.setattr(child, "resource", limits)
        monkeypatch.setattr(child, "signal", signals)
        monkeypatch.setattr(child, "die_with_parent", noted("die with"))
        monkeypatch.setattr(child, "adopt_orphans", noted("adopt"))


@pytest.mark.usefixtures("pipes")
@pytest.mark.parametrize("memory_mb", [None, 3])
def test_a_child_serves_its_parent_alone_and_leaves_the_machine_to_its_owner(
    memory_mb: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = System(monkeypatch)
    # Nor is a fleet's token any model's business.
    system.environ |= {"REHYB_TOKEN": "secret", "REHYB_URL": "http://there"}
    parent, theirs = multiprocessing.Pipe()
    bell_in, bell_out = multiprocessing.Pipe(duplex=False)
    with parent, theirs, bell_in, bell_out:
        # Bundle after bundle, until it can write no more.
        for names in ("ab", "c"):
            parent.send([asked(name) for name in names])
        served: list[str] = []

        def evaluate(instance: Mapping[str, Any]) -> Evaluation:
            served.append(instance["id"])
            if instance["id"] == "c":
                bell_in.close()
            return double(instance)

        with monkeypatch.context() as ignoring:
            ignoring.setattr("models.running.place.load", lambda instance: None)
            child.evaluate_until_closed(theirs, bell_out, evaluate, 77, memory_mb)
    assert served == ["a", "b", "c"]
    limit = [] if memory_mb is None else [("limit", "data", (3 * 2**20, 3 * 2**20))]
    assert system.asked == [
        ("signal", 2, 1),
        ("signal", 15, 1),
        ("die with", 77, 9),
        ("adopt",),
        ("nice", child.NICENESS),
        *limit,
    ]
    assert system.environ == dict.fromkeys(child.SINGLE_THREAD, "1")


def test_a_child_whose_parent_closes_the_pipe_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    System(monkeypatch)
    parent, theirs = multiprocessing.Pipe()
    parent.close()
    with theirs:
        child.evaluate_until_closed(theirs, theirs, double, 77, None)


def test_an_instance_needs_its_place_or_a_model_of_rehyb_s_own() -> None:
    assert needed({"model": "m", "place": "here"}) == "here"
    assert needed({"model": "m", "place": None}) == needed({"model": "m"}) == "m"


def test_what_no_child_could_evaluate_has_a_result_too() -> None:
    assert failed({"id": "a"}, Outcome.CRASHED, "gone", 0.5) == {
        "instance": "a",
        "outcome": "crashed",
        "outputs": {},
        "reason": "gone",
        "state": None,
        "wall_seconds": 0.5,
    }
    assert failed({"id": "a"}, Outcome.CRASHED, "gone")["wall_seconds"] == 0.0


def test_half_a_character_that_a_model_says_spoils_no_result(pipes: Pipes) -> None:
    """A program can write it as JSON, and no coordinator reads it."""

    def halved(_: Mapping[str, Any]) -> Evaluation:
        raise ModelFailure("diverged", "at \ud800 é", {"\udfff": ["\ud800"]})

    report = only(pipes, halved)
    assert report["reason"] == "at ? é" and report["state"] == {"?": ["?"]}
