"""A worker whose coordinator is away, not there yet, or none at all."""

from pathlib import Path
from typing import Any

import pytest

from models.running.pool import Finished
from rehyb.errors import Unauthorized, WrongProtocol
from tests.testbed.fleet.fake_coordinator import Work

pytestmark = pytest.mark.usefixtures("short_waits")


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


def test_what_a_worker_waits_for_at_its_start_and_later_is_told_once_and_with_what_to_do(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", logger="worker.agent")
    work = Work(tmp_path, [["a"]])
    work.coordinator.away = 3
    work.agent.run()
    waiting, found = (record.message for record in caplog.records[:2])
    assert waiting.endswith("or set REHYB_URL to where it listens; trying again until one answers")
    assert found == "the coordinator answers"
    assert set(work.coordinator.results) == {"a"}


def test_the_log_of_a_worker_tells_its_life_from_the_first_answer_to_the_last_instance(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", logger="worker")
    work = Work(tmp_path, [["s:0:0", "s:0:1"], ["s:1:0"], ["t:0:0"]], max_idle=0.2)
    idle_first = iter([None])
    grant = work.coordinator._grant

    work.coordinator._grant = lambda body: (  # type: ignore[method-assign]
        None if next(idle_first, False) is None else grant(body)
    )
    work.agent.run()
    assert caplog.messages == [
        "there is no work for now: asks again and again",
        "works on study s",
        "works on study t",
        "no work for 0.2 s: leaving",
        "takes no more work, and leaves when what runs is done (0)",
        "left, after 4 instances",
    ]


def test_a_server_that_fails_at_the_first_request_is_waited_for_too(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    work = Work(tmp_path, [], max_idle=0.2)
    work.coordinator.status = 503
    work.agent.run()
    (waiting,) = (record.message for record in caplog.records)
    assert waiting.endswith("answers; set REHYB_URL if the coordinator is elsewhere")


def test_what_answers_in_another_protocol_ends_a_worker_at_its_start_and_never_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = Work(tmp_path, [])
    client = work.agent.leases.client
    ask, wrong = client.lease, [False]

    def lease(**said: Any) -> Any:
        if wrong[0]:
            raise WrongProtocol("it does not speak TLS")
        wrong[0] = True
        return ask(**said)

    monkeypatch.setattr(client, "lease", lease)
    work.agent.run()
    assert wrong[0]
    with pytest.raises(WrongProtocol):
        work.new_agent("w2", client=client).run()


def test_a_refused_token_ends_the_worker_with_the_coordinators_own_words(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"]])
    work.coordinator.status = 401
    with pytest.raises(Unauthorized, match="not this token"):
        work.agent.run()
