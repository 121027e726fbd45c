"""What a worker asks for, what it owes, and when its coordinator hears of either."""

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from rehyb.errors import Conflict, Invalid
from worker.leases import LAST_WORDS_SECONDS, Leases, bundle_size, fitting, lease_size


class Coordinator:
    """Grants one lease, and notes what it is told of it."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str, int]] = []
        self.retry_after = 8.0
        self.lost = False
        self.model = "m"

    def lease(self, **request: Any) -> dict[str, Any]:
        names = "abc"[: request["max_instances"]]
        instances = [{"id": name, "model": self.model} for name in names]
        return {"id": "l", "fence": 7, "ttl_seconds": 30.0, "instances": instances}

    def renew(self, lease: str, fence: int) -> None:
        self.told.append(("renew", lease, fence))
        if self.lost:
            raise Conflict("it is another's")

    def release(self, lease: str, fence: int) -> None:
        self.told.append(("release", lease, fence))


@pytest.fixture
def coordinator() -> Coordinator:
    return Coordinator()


@pytest.fixture
def leases(coordinator: Coordinator) -> Leases:
    """Leases that may take five instances in all, on three processes."""
    client: Any = coordinator
    return Leases(
        client=client,
        worker={},
        models=lambda _: {"m": ""},
        processes=3,
        batch=10,
        left=5,
        rng=Random(1),
    )


def granted(leases: Leases, now: float = 0.0) -> None:
    request = leases.request(now)
    assert request is not None
    leases.ask(request, now)


def test_a_lease_is_renewed_at_a_third_of_its_life_and_under_its_fence(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    client: Any = coordinator
    leases.renew(client, 9.9)
    assert coordinator.told == []
    leases.renew(client, 10.0)
    leases.renew(client, 19.9)
    assert coordinator.told == [("renew", "l", 7)]
    # Results posted under it extend it as well.
    leases.extend("l", 19.9)
    leases.renew(client, 29.8)
    assert len(coordinator.told) == 1


def test_of_a_lease_that_is_lost_nothing_more_is_begun_or_told(
    leases: Leases, coordinator: Coordinator, caplog: pytest.LogCaptureFixture
) -> None:
    granted(leases)
    coordinator.lost = True
    client: Any = coordinator
    leases.renew(client, 10.0)
    leases.renew(client, 20.0)
    leases.drop_lost()
    leases.renew(client, 30.0)
    leases.release()
    assert (len(leases), len(leases.queue)) == (0, 0)
    assert coordinator.told == [("renew", "l", 7)]
    assert caplog.messages == [
        "lease l expired: what is not begun goes to other workers, and what runs is posted all the "
        "same"
    ]


def test_a_lease_that_ended_with_its_last_result_is_dropped_without_alarm(
    leases: Leases, coordinator: Coordinator, caplog: pytest.LogCaptureFixture
) -> None:
    granted(leases)
    while leases.queue:
        leases.finish(leases.queue.popleft(), 1.0)
    # The post that brings them has arrived, and its answer has not.
    coordinator.lost = True
    client: Any = coordinator
    leases.renew(client, 10.0)
    leases.drop_lost()
    assert (len(leases), caplog.text) == (0, "")


def of_its_model(leases: Leases) -> None:
    """Give up what a child had, of which the server does not answer, and all of its model."""
    leases.give_up_model(leases.queue.popleft())


@pytest.mark.parametrize("give_up", [Leases.give_up_queue, Leases.give_up, of_its_model])
def test_what_is_given_up_is_released(
    leases: Leases, coordinator: Coordinator, give_up: Callable[[Leases], None]
) -> None:
    granted(leases)
    leases.finish(leases.queue.popleft(), 1.0)
    give_up(leases)
    leases.release()
    assert (len(leases), coordinator.told) == (0, [("release", "l", 7)])


def test_what_is_given_up_in_two_steps_is_released_and_not_renewed_before(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    leases.give_up_queue()
    leases.give_up()
    client: Any = coordinator
    leases.renew(client, 10.0)
    leases.release()
    assert (len(leases), coordinator.told) == (0, [("release", "l", 7)])


def test_a_lease_of_which_a_child_has_a_part_is_renewed_although_the_rest_is_given_up(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    leases.queue.popleft()
    leases.give_up_queue()
    client: Any = coordinator
    leases.renew(client, 10.0)
    assert coordinator.told == [("renew", "l", 7)]


def test_a_lease_that_is_due_is_renewed_beside_one_that_is_not(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases, now=5.0)
    granted(leases)
    client: Any = coordinator
    leases.renew(client, 10.0)
    assert len(coordinator.told) == 1


def test_a_lease_with_every_result_needs_no_release(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    while leases.queue:
        leases.finish(leases.queue.popleft(), 1.0)
    assert leases.any_finished
    leases.release()
    assert (len(leases), coordinator.told) == (0, [])


def test_no_more_is_asked_for_than_may_be_begun(leases: Leases) -> None:
    granted(leases)
    assert leases.left == 2
    granted(leases)
    assert leases.left == 0 and leases.request(1e9) is None


def test_without_work_it_waits_half_to_all_of_what_it_is_told_and_logs_a_reason_once(
    leases: Leases, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(3):
        leases.take(None, "begun with MuJoCo 3", 100.0)
    assert leases.request(103.9) is None
    assert leases.request(108.0) is not None
    assert caplog.messages == ["begun with MuJoCo 3"]


def test_a_coordinator_that_refuses_the_machine_is_asked_again_after_a_while(
    leases: Leases, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Any, **_request: Any) -> None:
        raise Conflict("begun with MuJoCo 3")

    monkeypatch.setattr(Coordinator, "lease", refuse)
    granted(leases, now=100.0)
    assert leases.request(103.9) is None and leases.request(108.0) is not None
    assert caplog.messages == ["begun with MuJoCo 3"]


def test_it_asks_for_the_models_that_it_has_by_then_and_tells_their_canaries(
    leases: Leases,
) -> None:
    times: list[float] = []

    def models(now: float) -> dict[str, str]:
        times.append(now)
        return {"m": "", "n": "c0ffee"}

    leases.worker, leases.models = {"id": "w"}, models
    assert leases.request(3.0) == {
        "worker": {"id": "w", "canaries": {"n": "c0ffee"}},
        "models": ["m", "n"],
        "max_instances": 3,
    }
    assert times == [3.0]
    leases.models = lambda _: {"m": ""}
    asked = leases.request(3.0)
    assert asked is not None and asked["worker"] == {"id": "w"}


def test_how_long_an_instance_takes_is_a_running_mean_with_a_fifth_of_the_newest(
    leases: Leases,
) -> None:
    leases.left = None
    granted(leases)
    sizes = []
    # Two seconds of work on three processes: 6 of 1 s each, 5 of 1.2 s.
    for seconds in (1.0, 2.0):
        leases.finish(leases.queue.popleft(), seconds)
        asked = leases.request(0.0)
        sizes.append(asked and asked["max_instances"])
    assert sizes == [6, 5]


def test_of_a_dear_model_no_more_is_asked_for_because_a_cheap_one_was_computed_before(
    leases: Leases, coordinator: Coordinator
) -> None:
    leases.left, leases.models = None, lambda _: {"m": "", "dear": "", "unknown": ""}
    granted(leases)
    leases.finish(leases.queue.popleft(), 0.0)
    asked = leases.request(0.0)
    assert asked is not None
    assert (asked["max_instances"], asked["at_most"]) == (10, {"dear": 3, "unknown": 3})
    # The cheap one's are still in the queue.
    coordinator.model = "dear"
    granted(leases)
    leases.finish(leases.queue.pop(), 60.0)
    asked = leases.request(0.0)
    assert asked is not None
    assert (asked["max_instances"], asked["at_most"]) == (10, {"dear": 1, "unknown": 3})
    assert leases.ahead == 1, "what comes next is cheap"
    leases.models = lambda _: {"dear": ""}
    asked = leases.request(0.0)
    assert asked is not None and "at_most" not in asked and asked["max_instances"] == 1


def test_a_coordinator_that_knows_one_size_only_is_asked_for_that_of_the_dearest_model(
    leases: Leases, monkeypatch: pytest.MonkeyPatch
) -> None:
    leases.left, leases.models = None, lambda _: {"m": "", "dear": ""}
    granted(leases)
    leases.finish(leases.queue.popleft(), 0.0)
    asked: list[dict[str, Any]] = []

    def strict(self: Any, **request: Any) -> dict[str, Any] | None:
        asked.append(request)
        if "at_most" in request:
            raise Invalid("extra inputs are not permitted")
        return None

    monkeypatch.setattr(Coordinator, "lease", strict)
    granted(leases)
    assert [one["max_instances"] for one in asked] == [10, 3]
    # What it refuses for another reason is nobody's to hide.
    monkeypatch.setattr(leases, "models", lambda _: {"m": ""})

    def refuse(self: Any, **request: Any) -> None:
        raise Invalid("no")

    monkeypatch.setattr(Coordinator, "lease", refuse)
    with pytest.raises(Invalid, match="no"):
        granted(leases, now=1e9)


def test_a_child_gets_no_dear_instances_behind_cheap_ones(
    leases: Leases, coordinator: Coordinator
) -> None:
    leases.left = None
    granted(leases)
    leases.finish(leases.queue.popleft(), 0.0)
    coordinator.model = "dear"
    for _ in range(10):
        granted(leases)
    # Two are left of the cheap model; a child could take five of all.
    assert leases.bundle_size == 2
    leases.queue.popleft()
    leases.queue.popleft()
    assert leases.bundle_size == 1


@pytest.mark.parametrize(
    ("seconds_each", "processes", "size"),
    [
        # Before anything is known: one for each process.
        (None, 4, 4),
        (None, 16, 10),
        # Two seconds of work for every process, but never more than asked for.
        (0.0, 1, 10),
        (0.5, 1, 4),
        (0.5, 2, 8),
        (0.5, 4, 10),
        # Always something.
        (30.0, 1, 1),
        (1e300, 1, 1),
    ],
)
def test_a_worker_asks_for_two_seconds_of_work(
    seconds_each: float | None, processes: int, size: int
) -> None:
    assert lease_size(seconds_each, processes, batch=10) == size


@pytest.mark.parametrize(
    ("seconds_each", "processes", "waiting", "size"),
    [
        # Before anything is known, and of what takes its time: one.
        (None, 2, 1000, 1),
        (0.03, 2, 1000, 1),
        (1e300, 2, 1000, 1),
        # Of what is quick: what takes a twentieth of a second.
        (0.01, 2, 1000, 5),
        (0.0, 2, 1000, 100),
        # Towards the end fewer, so that no child is left with much.
        (0.0, 2, 40, 10),
        (0.0, 2, 43, 10),
        (0.0, 2, 3, 1),
        (0.0, 64, 100, 1),
    ],
)
def test_a_child_gets_several_instances_only_if_they_take_next_to_no_time(
    seconds_each: float | None, processes: int, waiting: int, size: int
) -> None:
    assert bundle_size(seconds_each, processes, waiting) == size


def test_more_work_is_asked_for_before_quick_instances_run_out(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    assert leases.ahead == 0
    leases.finish(leases.queue.popleft(), 0.0)
    # Half a lease of three; a tenth of a second would be 150.
    assert leases.ahead == 1
    leases.finish(leases.queue.popleft(), 100.0)
    assert leases.ahead == 0


@pytest.mark.parametrize(
    ("seconds_left", "seconds_each", "slowest", "size"),
    [
        # Before anything is known: one for each process.
        (100.0, 0.0, 0.0, 4),
        (100.0, 10.0, 10.0, 40),
        (10.0, 0.5, 0.5, 80),
        # The last one may be as slow as the slowest.
        (100.0, 10.0, 50.0, 24),
        (50.0, 10.0, 50.0, 0),
        (-1.0, 0.0, 0.0, 0),
    ],
)
def test_a_worker_that_must_leave_takes_what_it_can_finish(
    seconds_left: float, seconds_each: float, slowest: float, size: int
) -> None:
    assert fitting(seconds_left, seconds_each, slowest, processes=4) == size


def test_a_worker_that_must_leave_asks_for_less_and_then_for_nothing(leases: Leases) -> None:
    leases.leave_at = 100.0 + LAST_WORDS_SECONDS
    granted(leases)
    while leases.queue:
        leases.finish(leases.queue.popleft(), 40.0)
    asked = leases.request(10.0)
    assert asked is not None and not leases.ends_too_soon(59.0)
    assert leases.request(60.0) is None and leases.ends_too_soon(60.0)
    assert not leases.time_is_up(99.0) and leases.time_is_up(100.0)


def test_without_work_it_asks_before_its_time_only_if_there_is_more_to_ask_for(
    leases: Leases,
) -> None:
    leases.take(None, None, now=0.0)
    assert leases.request(0.1) is None
    leases.ask_soon()
    assert leases.request(0.1) is not None


def test_a_lease_is_renewed_until_its_last_result_is_posted(
    leases: Leases, coordinator: Coordinator
) -> None:
    granted(leases)
    for ticket in list(leases.queue):
        leases.finish(ticket, 0.1)
    # Posting them takes longer than the lease would last.
    client: Any = coordinator
    leases.renew(client, 10.0)
    leases.renew(client, 20.0)
    leases.release()
    leases.renew(client, 30.0)
    assert coordinator.told == [("renew", "l", 7)] * 2
