"""What a worker promises about close-loop jobs, whatever becomes of the coordinator."""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

import httpx2
import pytest

from analysis.closeloop.contract import REPORT_FILES
from analysis.interpretation.contract import code
from models.running.pool import Finished
from rehyb.client import Client
from tests.testbed.transport import CoordinatorTransport
from worker import backoff, renewing
from worker.close_loop import jobs as close_loop_jobs
from worker.close_loop.child import OUT, PROGRESS, can_close_loops
from worker.close_loop.jobs import CloseLoopJobs
from worker.close_loop.scratch import sweep

ARCHIVE = b"PK of a session"


class Coordinator:
    """As much of a coordinator as close-loop jobs can see."""

    def __init__(self) -> None:
        self.jobs = 1
        self.ttl = 60.0
        self.name = "monday"
        self.archive = ARCHIVE
        self.away = 0
        self.sick = 0
        self.without_database = 0
        self.refuse: set[str] = set()
        self.too_large = False
        #: How often a lease is renewed before a report has arrived; and whether none ever does.
        self.renewals_meanwhile = 0
        self.reports_lost = False
        self.asks: dict[str, Any] = {}
        self.said: list[tuple[str, Any]] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        verb = request.url.path.rsplit("/", 1)[-1]
        if verb not in ("lease", "archive") and self.away:
            self.away -= 1
            raise httpx2.ConnectError("connection refused")
        if verb == "archive":
            return httpx2.Response(200, content=self.archive)
        if verb == "lease":
            if not self.jobs:
                return httpx2.Response(204, headers={"Retry-After": "0"})
            self.jobs -= 1
            sha256 = hashlib.sha256(ARCHIVE).hexdigest()
            session = {"id": "s", "name": self.name, "sha256": sha256}
            job = {"id": "j", "lease": "l", "fence": 1, "ttl_seconds": self.ttl, **self.asks}
            self.said.append((verb, json.loads(request.read())))
            return httpx2.Response(201, json={**job, "session": session})
        if verb == "report" and self.reports_lost:
            self.said.append(("lost report", {}))
            raise httpx2.WriteTimeout("too slow")
        if verb == "report" and self.renewals_meanwhile:
            told = len(self.words("renew"))
            until(lambda: len(self.words("renew")) >= told + self.renewals_meanwhile)
        if verb in self.refuse:
            return httpx2.Response(409, json={"detail": "the lease is expired"})
        if verb == "report" and self.too_large:
            return httpx2.Response(413, json={"detail": "a session may have 5 bytes at most"})
        if verb == "report" and self.sick:
            self.sick -= 1
            return httpx2.Response(500, json={"status": 500, "detail": "its log says why"})
        if verb == "report" and self.without_database:
            self.without_database -= 1
            return httpx2.Response(503, json={"status": 503, "detail": "the database is away"})
        content = request.read()
        said = dict(request.url.params) if verb == "report" else json.loads(content)
        self.said.append((verb, {**said, "files": content} if verb == "report" else said))
        return httpx2.Response(200, json={})

    def words(self, verb: str) -> list[Any]:
        return [said for name, said in self.said if name == verb]


class InstantPool:
    """A pool whose one child has closed the loop when it is looked at, unless told otherwise."""

    def __init__(self) -> None:
        self.result: dict[str, Any] = {"outcome": "ok", "reason": "", "state": None}
        self.endless = False
        self.stages = ["reading"]
        self.archive = Path()
        self.killed = 0

    def start(self, instance: Mapping[str, Any], ticket: Any) -> None:
        self.instance = instance
        self.archive = Path(instance["parameters"]["archive"])
        assert self.archive.read_bytes() == ARCHIVE
        (self.archive.parent / OUT).mkdir()
        for name in REPORT_FILES:
            (self.archive.parent / OUT / name).write_text(f"<{name}>")

    def wait(self, seconds: float) -> list[Finished]:
        time.sleep(0.001)
        if self.stages:
            (self.archive.parent / PROGRESS).write_text(self.stages.pop(0))
            return []
        return [] if self.endless else [Finished(ticket=None, result=self.result)]

    def kill(self) -> None:
        self.killed += 1


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PROGRESS_SECONDS", "PAUSE_SECONDS"):
        monkeypatch.setattr(close_loop_jobs, name, 0.01)
    monkeypatch.setattr(renewing, "TICK_SECONDS", 0.002)
    monkeypatch.setattr(backoff, "FAREWELL_SECONDS", 0.01)
    monkeypatch.setattr(backoff, "full_jitter", lambda failures, rng: 0.001)


@pytest.fixture
def coordinator() -> Coordinator:
    return Coordinator()


@pytest.fixture
def pool() -> InstantPool:
    return InstantPool()


@pytest.fixture
def jobs(coordinator: Coordinator, pool: InstantPool, tmp_path: Path) -> Iterator[CloseLoopJobs]:
    transport = CoordinatorTransport(coordinator)
    with Client("http://coordinator:1", "secret", transport=transport) as client:
        jobs = CloseLoopJobs(
            client=client,
            pool=pool,  # type: ignore[arg-type]
            folder=tmp_path / "loops",
            worker={"id": "w", "host": "pc", "versions": {}, "tags": []},
            code="c0de",
            rng=Random(1),
        )
        yield jobs
        jobs.close()


def until(ask: Callable[[], object]) -> None:
    deadline = time.monotonic() + 10.0
    while not ask():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def test_a_job_is_done_and_its_files_handed_in(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool, tmp_path: Path
) -> None:
    jobs.start()
    until(lambda: coordinator.words("report") and not jobs.busy)
    (said,) = coordinator.words("report")
    assert (said["lease"], said["fence"], said["worker"], said["code"]) == ("l", "1", "w", "c0de")
    assert all(f"<{name}>".encode() in said["files"] for name in REPORT_FILES)
    assert coordinator.words("renew")[0]["progress"] == "reading"
    # The next session gets a fresh process, and nothing is left of this one.
    assert pool.killed and pool.archive.name == "monday.zip"
    assert not (tmp_path / "loops").exists()


def test_with_a_bank_it_interprets_and_says_which_bank_it_was(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool, tmp_path: Path
) -> None:
    options = {"known": [], "tolerance": None, "bank": None}
    coordinator.asks = {"kind": "interpretation", "options": options}
    jobs.bank = ("f779fd93d326", tmp_path / "bank.npz")
    # The file was extended after the worker began.
    pool.result["state"] = {"bank": "0123456789ab"}
    jobs.start()
    until(lambda: coordinator.words("report") and not jobs.busy)
    assert coordinator.words("lease")[0]["bank"] == "f779fd93d326"
    assert pool.instance["model"] == "interpretation"
    given = pool.instance["parameters"]
    assert (given["bank"], given["options"]) == (str(tmp_path / "bank.npz"), options)
    (said,) = coordinator.words("report")
    assert said["code"] == code("0123456789ab")
    assert b"<report.json>" in said["files"] and b"<residuals.csv>" not in said["files"]


def test_a_coordinator_that_is_away_gets_the_report_when_it_is_back(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.away = 20
    jobs.start()
    until(lambda: coordinator.words("report"))


def test_a_report_waits_for_a_database_that_is_away_for_however_long(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.without_database = 2 * close_loop_jobs.TRIES
    jobs.start()
    until(lambda: coordinator.words("report"))
    assert not coordinator.words("failure")


def test_a_coordinator_that_keeps_failing_is_left_alone(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.sick, coordinator.jobs = close_loop_jobs.TRIES, 2
    jobs.start()
    until(lambda: coordinator.words("report"))
    assert coordinator.sick == 0 and len(coordinator.words("report")) == 1
    (said,) = coordinator.words("failure")
    assert said["outcome"] == "crashed" and "its log says why" in said["reason"]


def test_a_report_that_the_coordinator_cannot_use_is_a_failure_with_its_words(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.too_large = True
    jobs.start()
    until(lambda: coordinator.words("failure"))
    (said,) = coordinator.words("failure")
    assert said["outcome"] == "crashed" and said["reason"].endswith("5 bytes at most")


def test_a_bad_session_is_said_with_its_place(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    place = {"file": "a.csv", "column": None, "line": 3}
    pool.result = {"outcome": "bad_session", "reason": "a.csv, line 3: no", "state": place}
    jobs.start()
    until(lambda: coordinator.words("failure"))
    (said,) = coordinator.words("failure")
    assert said | place == said and said["reason"] == "a.csv, line 3: no"


def test_a_crash_is_said_without_its_traceback(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    pool.result = {"outcome": "crashed", "reason": "it was", "state": {"traceback": "..."}}
    jobs.start()
    until(lambda: coordinator.words("failure"))
    (said,) = coordinator.words("failure")
    assert said["outcome"] == "crashed" and "traceback" not in said


def test_a_job_that_is_no_longer_ours_is_dropped(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    pool.endless = True
    coordinator.refuse = {"renew"}
    jobs.start()
    until(lambda: pool.killed and not jobs.busy)
    assert not coordinator.words("report") and not coordinator.words("failure")


def test_a_lease_is_kept_while_the_work_goes_on(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    coordinator.ttl, pool.endless = 0.01, True
    jobs.start()
    until(lambda: len(coordinator.words("renew")) > 5)
    assert jobs.busy == 1


def test_a_lease_is_kept_while_the_report_is_uploaded(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.ttl, coordinator.renewals_meanwhile = 0.01, 3
    jobs.start()
    until(lambda: coordinator.words("report") and not jobs.busy)


def test_a_lease_is_kept_no_longer_than_a_report_may_take_that_does_not_get_through(
    jobs: CloseLoopJobs, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(renewing, "STUCK_SECONDS", 0.05)
    coordinator.ttl, coordinator.reports_lost = 0.01, True
    jobs.start()
    until(lambda: coordinator.words("lost report"))
    time.sleep(0.2)
    renewed, tried = len(coordinator.words("renew")), len(coordinator.words("lost report"))
    until(lambda: len(coordinator.words("lost report")) > tried + 20)
    assert len(coordinator.words("renew")) == renewed
    assert jobs.busy == 1


def test_draining_finishes_the_job_and_asks_for_no_other(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    coordinator.jobs, pool.endless = 2, True
    jobs.start()
    until(lambda: jobs.busy)
    jobs.drain()
    pool.endless = False
    until(lambda: coordinator.words("report") and not jobs.busy)
    jobs.close()
    assert coordinator.jobs == 1


def test_leaving_at_once_gives_the_job_back(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool, tmp_path: Path
) -> None:
    pool.endless = True
    jobs.start()
    until(lambda: pool.archive.name)
    jobs.close()
    assert coordinator.words("release") == [{"lease": "l", "fence": 1}]
    assert pool.killed and not (tmp_path / "loops").exists()


def test_leaving_while_nobody_answers_takes_no_longer_than_a_farewell(
    jobs: CloseLoopJobs, coordinator: Coordinator
) -> None:
    coordinator.away = 10**9
    jobs.start()
    until(lambda: jobs.busy)
    jobs.drain()
    until(lambda: not jobs.busy)


def test_a_full_disk_is_this_machine_s_fault_and_is_counted(
    jobs: CloseLoopJobs, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(jobs, "_fetch", full)
    jobs.start()
    until(lambda: coordinator.words("failure"))
    (said,) = coordinator.words("failure")
    assert said["outcome"] == "crashed" and "No space left" in said["reason"]
    assert not coordinator.words("release")


def test_an_archive_that_did_not_arrive_whole_is_not_analysed(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool
) -> None:
    coordinator.archive = ARCHIVE[:-1]
    jobs.start()
    until(lambda: coordinator.words("release"))
    assert pool.archive == Path()


def test_a_session_s_name_names_a_file_in_the_job_s_folder_and_no_other(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool, tmp_path: Path
) -> None:
    coordinator.name = "../../x\0/" + "y" * 300
    jobs.start()
    until(lambda: coordinator.words("report"))
    assert pool.archive.parent.parent == tmp_path / "loops"


def test_what_a_killed_worker_left_is_removed_and_what_a_living_one_has_is_not(
    jobs: CloseLoopJobs, coordinator: Coordinator, pool: InstantPool, tmp_path: Path
) -> None:
    pool.endless = True
    dead = tmp_path / "loops" / "dead"
    dead.mkdir(parents=True)
    (dead / "session.zip").write_bytes(ARCHIVE)
    jobs.start()
    until(lambda: pool.archive.name)
    assert not dead.exists()
    sweep(tmp_path / "loops")
    assert pool.archive.exists()


def test_an_installation_without_pictures_cannot_close_loops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert can_close_loops()
    monkeypatch.setattr(
        "worker.close_loop.child.find_spec", lambda name: None if name == "matplotlib" else object()
    )
    assert not can_close_loops()
