"""What a worker promises its coordinator, whatever becomes of either."""

import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from models.running.pool import Finished
from rehyb.client import Client
from tests.testbed.fleet.fake_coordinator import Work
from worker.leases import LAST_WORDS_SECONDS
from worker.posting import TRIES

pytestmark = pytest.mark.usefixtures("short_waits")


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


def test_a_worker_that_still_checks_a_model_is_not_idle_and_asks_when_it_has_checked(
    tmp_path: Path,
) -> None:
    work = Work(tmp_path, [])
    checked_at = time.monotonic() + 5.0 * (work.max_idle or 0.0)
    asked_before: list[int] = []

    def check() -> bool:
        if time.monotonic() < checked_at:
            return True
        asked_before.append(len(work.coordinator.calls))
        return False

    work.agent.check_models = check
    work.agent.leases.client.retry_after = 30.0
    work.agent.run()
    assert time.monotonic() >= checked_at
    assert len(work.coordinator.calls) > asked_before[0]


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


def test_a_lease_is_not_kept_for_ever_when_renewals_get_through_and_results_do_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.renewing.TICK_SECONDS", 0.002)
    monkeypatch.setattr("worker.renewing.STUCK_SECONDS", 0.1)
    monkeypatch.setattr("worker.backoff.CAP_SECONDS", 0.02)
    work = Work(tmp_path, [["a"]], max_idle=None)
    work.coordinator.ttl = 0.03
    work.coordinator.clogged = True
    begun = time.monotonic()
    later: list[int] = []

    def done() -> bool:
        if time.monotonic() > begun + 0.4 and not later:
            later.append(len(work.coordinator.renewals))
        return time.monotonic() > begun + 0.6

    work.run_until(work.agent, done)
    assert 0 < len(work.coordinator.renewals) == later[0]
    assert work.spooled() == 1


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
    monkeypatch.setattr("worker.posting.ASIDE_SECONDS", 0.0)
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


def test_a_worker_that_fits_no_study_says_why_once_and_goes_on_asking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # It leaves with its last instance: idle seconds would pass on a machine with other work.
    work = Work(tmp_path, [["a"]], max_idle=None)
    work.coordinator.misfits = 3
    agent = work.new_agent("w2", max_instances=1)
    agent.leases.client.retry_after = 0.005
    agent.run()
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


def test_the_next_work_comes_with_the_acknowledgement_of_the_last(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"], ["b"], ["c"]], processes=1, max_idle=None)
    work.new_agent("w2", max_instances=3).run()
    assert set(work.coordinator.results) == {"a", "b", "c"}
    assert work.coordinator.calls == ["/v1/leases", *["/v1/results"] * 3]


def test_who_asks_for_more_posts_what_is_there_in_the_same_request(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b", "c"], ["d"]])
    work.pool.endless = {"c"}
    finish = work.pool.wait

    def finish_once_asked(seconds: float) -> list[Finished]:
        if len(work.coordinator.calls) > 1:
            work.pool.endless = set()
        return finish(seconds)

    work.pool.wait = finish_once_asked  # type: ignore[method-assign]
    work.agent.run()
    # While c runs, nothing waits any more.
    assert work.coordinator.calls[:2] == ["/v1/leases", "/v1/results"]
    assert set(work.coordinator.results) == {"a", "b", "c", "d"}


def test_an_older_coordinator_that_leases_nothing_with_results_gets_the_results_all_the_same(
    tmp_path: Path,
) -> None:
    work = Work(tmp_path, [["a"], ["b"]], processes=1, max_idle=None)
    work.coordinator.old = True
    work.new_agent("w2", max_instances=2).run()
    assert set(work.coordinator.results) == {"a", "b"}
    assert work.coordinator.calls.count("/v1/leases") == 2


def test_a_misfit_that_comes_with_verdicts_is_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    work = Work(tmp_path, [["a"], ["b"]], processes=1, max_idle=None)
    agent = work.new_agent("w2", max_instances=2)
    work.coordinator.misfits = 0

    def grant_then_refuse(body: Mapping[str, Any]) -> dict[str, Any] | None:
        work.coordinator.misfits = 3 if len(work.coordinator.batches) == 2 else 0
        return grant(body)

    grant = work.coordinator._grant
    work.coordinator._grant = grant_then_refuse  # type: ignore[method-assign]
    agent.run()
    assert set(work.coordinator.results) == {"a", "b"}
    assert caplog.text.count("begun with MuJoCo 3") == 1


def test_a_worker_whose_time_is_up_gives_back_what_runs(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a", "b"]], processes=2, max_idle=None)
    work.pool.endless = {"b"}
    work.agent.leases.leave_at = time.monotonic() + LAST_WORDS_SECONDS + 0.05
    work.agent.run()
    assert set(work.coordinator.results) == {"a"}
    assert work.coordinator.released == ["lease-of-a"]
    assert work.pool.killed


def test_a_worker_whose_time_is_up_waits_for_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.leases.LAST_WORDS_SECONDS", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        with Client(url, "t", timeout=60.0) as client:
            agent = Work(tmp_path, [], max_idle=None).new_agent("w2", client=client)
            agent.spool.add([("lease-of-a", 1, {"instance": "a", "outcome": "ok"})])
            began = time.monotonic()
            agent.leases.leave_at = began + 0.3
            agent.run()
    assert 0.3 <= time.monotonic() - began < 30.0
