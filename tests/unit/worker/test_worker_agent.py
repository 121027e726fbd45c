"""What a worker promises its coordinator, whatever becomes of either."""

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import httpx2
import pytest

from rehyb.client import Client
from rehyb.errors import Unauthorized
from worker.agent import TRIES, Agent
from worker.pool import Finished
from worker.spool import Spool


class Coordinator:
    """As much of a coordinator as a worker can see, on the other end of a mock transport."""

    def __init__(self, batches: list[list[str]]) -> None:
        self.batches = batches
        self.ttl = 60.0
        self.calls: list[str] = []
        self.results: dict[str, dict[str, Any]] = {}
        self.renewals: list[str] = []
        self.released: list[str] = []
        self.away = 0
        self.refuse_renewals = False
        self.unusable: set[str] = set()
        self.refused: set[str] = set()
        self.poison: set[str] = set()
        self.sick = 0
        self.status: int | None = None
        self.misfits = 0
        self.sizes: list[int] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        self.calls.append(path)
        if self.away:
            self.away -= 1
            raise httpx2.ConnectError("connection refused")
        if self.status:
            return httpx2.Response(self.status, json={"title": "no", "detail": "not this token"})
        body = json.loads(request.content)
        if path == "/v1/leases":
            return self._lease(body)
        if path.endswith("/renew"):
            self.renewals.append(path.split("/")[-2])
            if self.refuse_renewals:
                return httpx2.Response(409, json={"detail": "expired"})
            return httpx2.Response(200, json={"ttl_seconds": self.ttl})
        if path.endswith("/release"):
            self.released.append(path.split("/")[-2])
            return httpx2.Response(200, json={})
        return self._results(body)

    def _lease(self, body: Mapping[str, Any]) -> httpx2.Response:
        self.sizes.append(body["max_instances"])
        if self.misfits:
            self.misfits -= 1
            return httpx2.Response(409, json={"detail": "this study was begun with MuJoCo 3"})
        if not self.batches:
            return httpx2.Response(204, headers={"Retry-After": "0"})
        instances = [
            {"id": name, "model": "ishigami", "parameters": {"x1": 0.0}}
            for name in self.batches.pop(0)
        ]
        lease = f"lease-of-{instances[0]['id']}"
        answer = {"id": lease, "fence": 7, "ttl_seconds": self.ttl, "instances": instances}
        return httpx2.Response(201, json=answer)

    def _results(self, body: Mapping[str, Any]) -> httpx2.Response:
        names = [result["instance"] for result in body["results"]]
        if self.sick or self.poison & set(names):
            self.sick -= self.sick > 0
            return httpx2.Response(500, json={"status": 500, "detail": "its log says why"})
        if self.unusable & set(names):
            return httpx2.Response(422, json={"detail": "one of them is malformed"})
        verdicts = []
        for result in body["results"]:
            verdict = "conflict" if result["instance"] in self.refused else "accepted"
            verdicts.append({"instance": result["instance"], "verdict": verdict, "detail": ""})
            if verdict == "accepted":
                self.results[result["instance"]] = {**result, "lease": body["lease"]}
        return httpx2.Response(409 if self.refused else 200, json={"verdicts": verdicts})


class InstantPool:
    """A pool whose instances finish when they are looked at, unless told to take for ever."""

    def __init__(self, processes: int) -> None:
        self.processes = processes
        self.endless: set[str] = set()
        self.started: list[str] = []
        self.killed = False
        self._busy: list[tuple[Mapping[str, Any], Any]] = []

    @property
    def free(self) -> int:
        return self.processes - len(self._busy)

    @property
    def running(self) -> int:
        return len(self._busy)

    def start(self, instance: Mapping[str, Any], ticket: Any) -> None:
        self.started.append(instance["id"])
        self._busy.append((instance, ticket))

    def wait(self, seconds: float) -> list[Finished]:
        time.sleep(0.001)
        done = [(i, t) for i, t in self._busy if i["id"] not in self.endless]
        self._busy = [(i, t) for i, t in self._busy if i["id"] in self.endless]
        return [
            Finished(
                ticket=t,
                result={
                    "instance": i["id"],
                    "outcome": "ok",
                    "outputs": {"y": 0.5},
                    "wall_seconds": 0.001,
                },
            )
            for i, t in done
        ]

    def kill(self) -> None:
        self.killed = True
        self._busy.clear()


class Work:
    """A worker with its coordinator, its pool and its spool folder."""

    def __init__(
        self,
        folder: Path,
        batches: list[list[str]],
        processes: int = 1,
        max_idle: float | None = 0.05,
    ) -> None:
        self.coordinator = Coordinator(batches)
        self.pool = InstantPool(processes)
        self.folder = folder
        self.max_idle = max_idle
        self.agent = self.new_agent()

    def new_agent(self, name: str = "w1", max_instances: int | None = None) -> Agent:
        return Agent(
            client=Client("http://c", "t", transport=httpx2.MockTransport(self.coordinator)),
            pool=self.pool,  # type: ignore[arg-type]
            spool=Spool(self.folder, name),
            worker={"id": name, "host": "h", "versions": {}},
            models=("ishigami",),
            batch=10,
            max_idle=self.max_idle,
            rng=Random(1),
            max_instances=max_instances,
        )

    def run_until(self, agent: Agent, done: Callable[[], bool]) -> None:
        """Run a worker that leaves when `done`, however long it has to wait meanwhile."""
        finish = self.pool.wait

        def look(seconds: float) -> list[Finished]:
            if done():
                agent.stop()
            return finish(seconds)

        self.pool.wait = look  # type: ignore[method-assign]
        agent.run()
        self.pool.wait = finish  # type: ignore[method-assign]

    def spooled(self) -> int:
        return len(list(self.folder.glob("*.spool")))


@pytest.fixture(autouse=True)
def short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the tests to milliseconds: the lengths of the waits are not what they are about."""
    monkeypatch.setattr("worker.backoff.BASE_SECONDS", 0.005)
    monkeypatch.setattr("worker.agent.FAREWELL_SECONDS", 0.05)


def test_every_leased_instance_gets_its_result_posted_under_its_lease(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b", "c"], ["d"]], processes=2)
    work.agent.run()
    leases = {name: result["lease"] for name, result in work.coordinator.results.items()}
    assert leases == {"a": "lease-of-a", "b": "lease-of-a", "c": "lease-of-a", "d": "lease-of-d"}
    assert work.coordinator.released == []
    assert work.spooled() == 0


def test_a_worker_without_work_leaves_after_max_idle(tmp_path: Path) -> None:
    work = Work(tmp_path, [])
    work.agent.run()
    assert set(work.coordinator.calls) == {"/v1/leases"}
    assert work.pool.killed


def test_a_coordinator_that_is_away_gets_the_results_when_it_is_back(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b"]])
    finish = work.pool.wait

    def leave_once_busy(seconds: float) -> list[Finished]:
        if work.pool.started == ["a"]:
            work.coordinator.away = 5
        return finish(seconds)

    work.pool.wait = leave_once_busy  # type: ignore[method-assign]
    work.agent.run()
    assert set(work.coordinator.results) == {"a", "b"}
    assert work.coordinator.away == 0


def test_results_nobody_takes_stay_on_disk_and_the_next_worker_posts_them(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"]])
    finish = work.pool.wait

    def leave_for_good(seconds: float) -> list[Finished]:
        if work.pool.started:
            work.coordinator.away = 1_000_000
        return finish(seconds)

    work.pool.wait = leave_for_good  # type: ignore[method-assign]
    work.agent.run()
    assert work.coordinator.results == {}
    assert work.spooled() == 1
    work.coordinator.away = 0
    work.pool.wait = finish  # type: ignore[method-assign]
    work.new_agent("w2").run()
    assert work.coordinator.results["a"]["lease"] == "lease-of-a"
    assert work.spooled() == 0


def test_a_lease_is_renewed_while_its_instances_run(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"]])
    work.coordinator.ttl = 0.03
    work.pool.endless = {"a"}
    finish = work.pool.wait

    def finish_after_three_renewals(seconds: float) -> list[Finished]:
        if len(work.coordinator.renewals) >= 3:
            work.pool.endless = set()
        return finish(seconds)

    work.pool.wait = finish_after_three_renewals  # type: ignore[method-assign]
    work.agent.run()
    assert work.coordinator.renewals[:3] == ["lease-of-a"] * 3
    assert set(work.coordinator.results) == {"a"}


def test_nothing_more_of_an_expired_lease_is_begun_but_what_runs_is_still_posted(
    tmp_path: Path,
) -> None:
    work = Work(tmp_path, [["a", "b", "c"]])
    work.coordinator.ttl = 0.03
    work.coordinator.refuse_renewals = True
    work.pool.endless = {"a"}
    finish = work.pool.wait

    def finish_after_refusal(seconds: float) -> list[Finished]:
        if work.coordinator.renewals:
            work.pool.endless = set()
        return finish(seconds)

    work.pool.wait = finish_after_refusal  # type: ignore[method-assign]
    work.agent.run()
    assert work.pool.started == ["a"]
    assert set(work.coordinator.results) == {"a"}


def test_a_refused_result_is_not_posted_again(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b"]])
    work.coordinator.refused = {"a"}
    work.agent.run()
    assert set(work.coordinator.results) == {"b"}
    assert work.spooled() == 0


def test_a_result_the_coordinator_cannot_read_does_not_hold_back_the_others(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b", "c"]], processes=3)
    work.coordinator.unusable = {"b"}
    work.agent.run()
    assert set(work.coordinator.results) == {"a", "c"}
    assert work.spooled() == 0


def test_a_result_at_which_the_coordinator_fails_is_set_aside_for_the_next_worker(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    work = Work(tmp_path, [["a", "b", "c"], ["d"]], processes=3, max_idle=None)
    work.coordinator.poison = {"b"}
    work.run_until(work.agent, lambda: set(work.coordinator.results) == {"a", "c", "d"})
    assert sum("fails at the result of b" in record.message for record in caplog.records) == 1
    # TRIES together, each of three once alone, and "d".
    assert work.coordinator.calls.count("/v1/results") == TRIES + 3 + 1
    work.coordinator.poison = set()
    work.run_until(work.new_agent("w2"), lambda: "b" in work.coordinator.results)
    assert set(work.coordinator.results) == {"a", "b", "c", "d"}
    assert work.spooled() == 0


def test_what_was_set_aside_is_posted_again_after_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.agent.ASIDE_SECONDS", 0.0)
    monkeypatch.setattr("worker.agent.POST_SECONDS", 0.0)
    work = Work(tmp_path, [["a"], ["b"]], max_idle=None)
    # As a full disk would have it: everything fails, for longer than anybody tries.
    work.coordinator.sick = TRIES + 2
    work.run_until(work.agent, lambda: set(work.coordinator.results) == {"a", "b"})
    assert set(work.coordinator.results) == {"a", "b"}
    assert work.spooled() == 0


def test_draining_finishes_what_runs_and_releases_the_rest(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b", "c"]])
    finish = work.pool.wait

    def stop_once_busy(seconds: float) -> list[Finished]:
        if work.pool.started == ["a"]:
            work.agent.stop()
        return finish(seconds)

    work.pool.wait = stop_once_busy  # type: ignore[method-assign]
    work.agent.run()
    assert work.pool.started == ["a"]
    assert set(work.coordinator.results) == {"a"}
    assert work.coordinator.released == ["lease-of-a"]
    last_two = [path.split("/")[-1] for path in work.coordinator.calls[-2:]]
    assert last_two == ["results", "release"]


def test_a_second_request_to_stop_releases_at_once(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b"]])
    work.pool.endless = {"a"}
    finish = work.pool.wait

    def stop_twice_once_busy(seconds: float) -> list[Finished]:
        if work.pool.started:
            work.agent.stop()
        return finish(seconds)

    work.pool.wait = stop_twice_once_busy  # type: ignore[method-assign]
    work.agent.run()
    assert work.pool.killed
    assert work.coordinator.results == {}
    assert work.coordinator.released == ["lease-of-a"]


def test_a_refused_token_ends_the_worker_with_the_coordinators_own_words(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"]])
    work.coordinator.status = 401
    with pytest.raises(Unauthorized, match="not this token"):
        work.agent.run()


def test_a_worker_that_fits_no_study_says_why_once_and_goes_on_asking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    work = Work(tmp_path, [["a"]])
    work.coordinator.misfits = 3
    work.agent._client.retry_after = 0.005
    work.agent.run()
    assert [record.message for record in caplog.records if record.levelname == "WARNING"] == [
        "this study was begun with MuJoCo 3"
    ]
    assert set(work.coordinator.results) == {"a"}


def test_a_worker_leaves_after_as_many_instances_as_it_was_to_do(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b"], ["c"], ["d"]], processes=2)
    agent = work.new_agent("w2", max_instances=3)
    agent.run()
    assert set(work.coordinator.results) == {"a", "b", "c"}
    assert work.coordinator.sizes == [2, 1]
    assert work.coordinator.released == []
