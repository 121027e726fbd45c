"""Whatever becomes of a child process, its instance gets exactly one well-formed result."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from models.evaluation import Evaluation
from models.running.pool import Finished, Pool


def behave(instance: Mapping[str, Any]) -> Evaluation:
    """Stand in for the simulation: the model's name says how it behaves."""
    model, parameters = instance["model"], instance["parameters"]
    if model == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if model == "exit":
        os._exit(3)
    if model == "hang":
        time.sleep(60)
    if model == "hoard":
        return Evaluation(outcome="ok", outputs={"y": len(bytearray(2**30))}, wall_seconds=0.0)
    if model == "doze":
        time.sleep(0.7)
    if model == "twins":
        # The other one comes back as well, and answers as if it were the child.
        os.fork()
    if model == "fork":
        return Evaluation(outcome="ok", outputs={"y": float(_forked())}, wall_seconds=0.0)
    if model == "raise":
        raise ZeroDivisionError("the arm has no length")
    if model == "environment":
        threads = float(os.environ["OMP_NUM_THREADS"])
        outputs = {"threads": threads, "nice": float(os.nice(0))}
        return Evaluation(outcome="ok", outputs=outputs, wall_seconds=0.0)
    if model == "not_a_number":
        return Evaluation(outcome="ok", outputs={"y": float("nan")}, wall_seconds=0.0)
    if model == "unstable":
        state = {"qpos": [0.1, float("inf")], "time": float("nan")}
        return Evaluation(
            outcome="unstable", outputs={}, reason="it blew up", state=state, wall_seconds=0.1
        )
    return Evaluation(outcome="ok", outputs={"y": parameters["x"] * 2.0}, wall_seconds=0.0)


def _forked() -> int:
    """Start a process that starts another and stays; return the other's number."""
    shell = ["sh", "-c", "sleep 300 & echo $!; wait"]
    program = subprocess.Popen(shell, stdout=subprocess.PIPE, start_new_session=True)
    assert program.stdout is not None
    return int(program.stdout.readline())


@pytest.fixture
def pool() -> Iterator[Pool]:
    pool = Pool(processes=1, instance_seconds=20.0, evaluate=behave)
    yield pool
    pool.kill()


def instance(model: str, x: float = 1.0) -> dict[str, object]:
    return {"id": f"{model}-{x}", "model": model, "parameters": {"x": x}}


def finish(pool: Pool) -> Finished:
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        if finished := pool.wait(0.5):
            (one,) = finished
            return one
    raise AssertionError("nothing finished within 30 s")


def compute(pool: Pool, model: str, x: float = 1.0) -> Finished:
    pool.start(instance(model, x), ticket=x)
    return finish(pool)


def test_an_instance_comes_back_with_its_ticket_and_its_outputs(pool: Pool) -> None:
    done = compute(pool, "double", 0.1)
    assert done.ticket == 0.1
    assert done.result["instance"] == "double-0.1"
    assert (done.result["outcome"], done.result["outputs"]) == ("ok", {"y": 0.2})


@pytest.mark.parametrize(("model", "how"), [("segfault", "SIGSEGV"), ("exit", "status 3")])
def test_a_crash_is_a_result_and_the_next_instance_is_computed(
    pool: Pool, model: str, how: str
) -> None:
    crashed = compute(pool, model).result
    assert crashed["outcome"] == "crashed"
    assert how in crashed["reason"]
    assert compute(pool, "double").result["outcome"] == "ok"


def test_an_exception_is_a_crash_with_its_traceback(pool: Pool) -> None:
    crashed = compute(pool, "raise").result
    assert crashed["outcome"] == "crashed"
    assert crashed["reason"] == "ZeroDivisionError: the arm has no length"
    assert "in behave" in crashed["state"]["traceback"]


def test_a_hang_is_ended_and_reported_as_timed_out() -> None:
    pool = Pool(processes=1, instance_seconds=1.5, evaluate=behave)
    try:
        began = time.monotonic()
        hung = compute(pool, "hang").result
        assert hung["outcome"] == "timed_out"
        assert "1.5 s" in hung["reason"]
        assert 1.5 <= time.monotonic() - began < 10.0
        assert pool.free == 1
    finally:
        pool.kill()


def test_an_output_that_is_no_number_is_a_failure_that_says_which(pool: Pool) -> None:
    result = compute(pool, "not_a_number").result
    assert (result["outcome"], result["outputs"]) == ("not_finite", {})
    assert result["reason"] == "y came out as nan"


def test_a_failure_keeps_its_name_and_a_state_that_is_plain_json(pool: Pool) -> None:
    result = compute(pool, "unstable").result
    assert (result["outcome"], result["reason"]) == ("unstable", "it blew up")
    assert result["state"] == {"qpos": [0.1, None], "time": None}
    json.dumps(result, allow_nan=False)


def test_a_child_uses_one_thread_and_yields_to_others(pool: Pool) -> None:
    outputs = compute(pool, "environment").result["outputs"]
    assert outputs == {"threads": 1.0, "nice": min(float(os.nice(0)) + 5.0, 19.0)}


def test_a_child_that_died_while_idle_costs_no_instance(pool: Pool) -> None:
    compute(pool, "double")
    (child,) = pool._idle
    child._process.kill()
    child._process.join()
    assert compute(pool, "double", 3.0).result["outputs"] == {"y": 6.0}


def test_signals_to_the_whole_group_do_not_interrupt_an_instance(pool: Pool) -> None:
    compute(pool, "double")
    (child,) = pool._idle
    assert child._process.pid is not None
    for number in (signal.SIGTERM, signal.SIGINT):
        os.kill(child._process.pid, number)
    assert compute(pool, "double", 2.0).result["outputs"] == {"y": 4.0}
    assert pool._idle == [child]


def bundled(pool: Pool, *models: str, unread: float = 0.0) -> list[tuple[int, str]]:
    """Return (ticket, outcome) in the order in which one bundle's instances are done.

    Nobody reads what the child writes in its first `unread` seconds.
    """
    pool.start_bundle([(instance(model, x), x) for x, model in enumerate(models)])
    assert pool.running == len(models)
    time.sleep(unread)
    done: list[Finished] = []
    deadline = time.monotonic() + 40.0
    while len(done) < len(models) and time.monotonic() < deadline:
        done += pool.wait(0.5)
    for one in done:
        assert one.result["instance"] == f"{models[one.ticket]}-{one.ticket}"
        if one.result["outcome"] == "ok":
            assert one.result["outputs"] == {"y": 2.0 * one.ticket}
    assert (pool.running, pool.free) == (0, pool.processes)
    return [(one.ticket, one.result["outcome"]) for one in done]


def test_a_crash_in_a_bundle_is_that_of_one_instance_and_the_others_are_computed(
    pool: Pool,
) -> None:
    found = bundled(pool, "double", "raise", "double", "segfault", "double", "exit", "double")
    outcomes = ["ok", "crashed", "ok", "crashed", "ok", "crashed", "ok"]
    assert found == list(enumerate(outcomes))


def test_each_instance_of_a_bundle_has_the_time_limit_to_itself() -> None:
    pool = Pool(processes=1, instance_seconds=1.5, evaluate=behave)
    try:
        compute(pool, "double")
        outcomes = [o for _, o in bundled(pool, "doze", "doze", "doze", "hang", "double")]
    finally:
        pool.kill()
    assert outcomes == ["ok", "ok", "ok", "timed_out", "ok"]


def test_to_start_a_child_takes_none_of_an_instance_s_time(pool: Pool) -> None:
    pool.start({**instance("double", 3.0), "time_limit": 0.02}, None)
    assert finish(pool).result["outputs"] == {"y": 6.0}


def test_the_first_results_of_a_bundle_are_there_while_a_later_one_hangs(pool: Pool) -> None:
    pool.start_bundle([(instance("double"), 1), (instance("hang"), 2)])
    assert finish(pool).ticket == 1
    assert (pool.running, pool.free) == (1, 0)


@pytest.mark.parametrize("unread", [0.0, 0.3], ids=["read at once", "read together"])
def test_a_second_answer_is_no_other_instance_s(pool: Pool, unread: float) -> None:
    compute(pool, "double")
    outcomes = bundled(pool, "double", "twins", "double", "double", "double", unread=unread)
    assert sorted(ticket for ticket, _ in outcomes) == [0, 1, 2, 3, 4]
    assert outcomes[0] == (0, "ok")
    assert {o for _, o in outcomes} <= {"ok", "crashed"}


def test_more_than_one_instance_per_process_is_a_mistake(pool: Pool) -> None:
    pool.start(instance("hang"), ticket=None)
    assert (pool.free, pool.running) == (0, 1)
    with pytest.raises(RuntimeError, match="busy"):
        pool.start(instance("double"), ticket=None)


def test_an_instance_that_takes_too_much_memory_has_crashed_and_the_next_one_runs() -> None:
    pool = Pool(1, instance_seconds=30.0, evaluate=behave, memory_mb=500)
    try:
        (hoarder,) = evaluate(pool, "hoard")
        (modest,) = evaluate(pool, "double")
    finally:
        pool.kill()
    assert (hoarder.result["outcome"], "MemoryError" in hoarder.result["reason"]) == (
        "crashed",
        True,
    )
    assert modest.result["outcome"] == "ok"


def evaluate(pool: Pool, model: str) -> list[Finished]:
    pool.start({"id": model, "model": model, "parameters": {"x": 1.0}}, None)
    while not (finished := pool.wait(1.0)):
        pass
    return finished


def test_what_a_model_s_program_started_ends_with_its_child(pool: Pool) -> None:
    pool.start(instance("fork"), None)
    forked = int(finish(pool).result["outputs"]["y"])
    os.kill(forked, 0)
    pool.kill()
    deadline = time.monotonic() + 10.0
    while Path(f"/proc/{forked}").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not Path(f"/proc/{forked}").exists()


def test_the_time_limit_of_rehybs_own_models_begins_when_they_are_loaded() -> None:
    """MuJoCo and the elbow take longer to import than one of its evaluations."""
    point = {"id": "i", "model": "elbow_bushing", "parameters": {}}

    def first(instance_seconds: float) -> Finished:
        pool = Pool(processes=1, instance_seconds=instance_seconds)
        pool.start(point, "first")
        done = finish(pool)
        pool.kill()
        return done

    begun = time.monotonic()
    first(60.0)
    # A busy machine takes longer for both: importing is nearly all of it on any.
    limited = first(0.5 * (time.monotonic() - begun))
    assert limited.result["outcome"] == "ok", limited.result
