"""Results get to the coordinator, past those that it cannot take and those that it fails at."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rehyb.errors import Invalid, ServerError
from worker import posting
from worker.posting import ASIDE_SECONDS, TRIES, Posting
from worker.spool import Batch, Spool

ASKED = {"worker": {"id": "w"}, "models": ["m"], "max_instances": 3}


class Clock:
    """The monotonic clock, which only a test moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


class Coordinator:
    """Takes results, but where it fails or cannot read them; an answer takes 7 s."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        #: By the instance that spoils a request.
        self.errors: dict[str, Exception] = {}
        self.verdicts: dict[str, str] = {}
        #: Whether it leases instances in its answers to results.
        self.leases = True
        #: (instances, whether work was asked for), of each request.
        self.asked: list[tuple[str, bool]] = []
        self.taken: list[str] = []

    def post_results(
        self, *, lease: str, fence: int, worker: str, results: Any
    ) -> list[dict[str, Any]]:
        return self._take((lease, fence, worker), results, asking=False)

    def exchange(
        self, *, lease: str, fence: int, worker: str, results: Any, request: Any
    ) -> dict[str, Any]:
        assert request == ASKED
        if not self.leases:
            self.asked.append(("".join(one["instance"] for one in results), True))
            raise Invalid("next is unknown")
        verdicts = self._take((lease, fence, worker), results, asking=True)
        return {"verdicts": verdicts, "next": {"id": "n"}, "misfit": "no such tag"}

    def _take(self, who: tuple[str, int, str], results: Any, *, asking: bool) -> Any:
        assert who == ("l", 4, "w")
        names = [one["instance"] for one in results]
        self.asked.append(("".join(names), asking))
        self.clock.now += 7.0
        for name in names:
            if name in self.errors:
                raise self.errors[name]
        self.taken += names
        return [
            {"instance": name, "verdict": self.verdicts.get(name, "accepted"), "detail": "why"}
            for name in names
        ]


class Told:
    """Leases that only note what they are told."""

    def __init__(self) -> None:
        self.extended: list[tuple[str, float]] = []
        self.took: list[tuple[Any, Any, float]] = []

    def extend(self, lease: str, now: float) -> None:
        self.extended.append((lease, now))

    def take(self, granted: Any, ineligible: Any, now: float) -> None:
        self.took.append((granted, ineligible, now))


class Desk:
    """A worker with four results to post, a to d, of one lease."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        clock = Clock()
        monkeypatch.setattr(posting, "time", clock)
        self.clock, self.coordinator, self.leases = clock, Coordinator(clock), Told()
        self.spool = Spool(folder, "w")
        self.spool.add([("l", 4, {"instance": name}) for name in "abcd"])
        client: Any = self.coordinator
        leases: Any = self.leases
        self.posting = Posting(client=client, spool=self.spool, leases=leases)

    def post(self, request: Mapping[str, Any] | None = None) -> None:
        batch = self.spool.next_batch()
        assert batch is not None
        self.posting.post(batch, request)

    @property
    def left(self) -> str:
        """What the spool would have posted next."""
        batch = self.spool.next_batch()
        return "" if batch is None else "".join(one["instance"] for one in batch.results)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(tmp_path, monkeypatch)


def failing(status: int = 500) -> ServerError:
    return ServerError("it fails", {"status": status})


def failures(desk: Desk, how_often: int, post: Callable[[], None] | None = None) -> None:
    for _ in range(how_often):
        with pytest.raises(ServerError):
            (post or desk.post)()


def test_what_is_taken_is_forgotten_and_its_lease_lasts_from_before_the_request(
    desk: Desk,
) -> None:
    desk.post()
    assert desk.coordinator.asked == [("abcd", False)]
    assert (len(desk.spool), desk.leases.extended, desk.leases.took) == (0, [("l", 1000.0)], [])


def test_the_next_lease_comes_with_the_answer_and_lasts_from_before_the_request(
    desk: Desk,
) -> None:
    desk.post(ASKED)
    assert desk.coordinator.asked == [("abcd", True)]
    assert desk.leases.took == [({"id": "n"}, "no such tag", 1000.0)]


def test_results_that_are_not_taken_for_one_reason_are_one_line(
    desk: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk.coordinator.verdicts = dict.fromkeys("abd", "unknown") | {"c": "conflict"}
    desk.post()
    assert caplog.messages == [
        "the result of instance a and of 2 more is not taken: unknown: why",
        "the result of instance c is not taken: conflict: why",
    ]


def test_every_verdict_is_final_and_only_those_that_refuse_are_told(
    desk: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk.coordinator.verdicts = {"b": "duplicate", "c": "conflict", "d": "unknown"}
    desk.post()
    assert len(desk.spool) == 0
    assert caplog.messages == [
        "the result of instance c is not taken: conflict: why",
        "the result of instance d is not taken: unknown: why",
    ]


def test_a_coordinator_that_leases_nothing_with_results_is_posted_to_without_asking(
    desk: Desk,
) -> None:
    desk.coordinator.leases = False
    desk.post(ASKED)
    assert desk.coordinator.asked == [("abcd", True), ("abcd", False)]
    assert (len(desk.spool), desk.leases.took) == (0, [])


def test_a_result_that_cannot_be_used_is_dropped_with_a_word_and_the_others_get_through(
    desk: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk.coordinator.errors = {"c": Invalid("no number")}
    desk.post(ASKED)
    assert desk.coordinator.taken == ["a", "b", "d"]
    assert len(desk.spool) == 0
    assert caplog.messages == [
        "the coordinator cannot use a result: no number: {'instance': 'c'}",
    ]


@pytest.mark.parametrize("status", [429, 503])
def test_a_coordinator_that_is_busy_is_not_held_against_what_was_posted(
    desk: Desk, status: int
) -> None:
    desk.coordinator.errors = {"a": failing(status)}
    failures(desk, 3 * TRIES)
    assert {asked for asked, _ in desk.coordinator.asked} == {"abcd"}
    assert desk.left == "abcd"


def test_what_the_coordinator_fails_at_is_tried_five_times_and_then_set_aside_alone(
    desk: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk.coordinator.errors = {"c": failing()}
    failures(desk, TRIES - 1)
    assert desk.left == "abcd"
    desk.post(ASKED)
    # Each by itself, and no work is asked for with any: who asked has an answer to come.
    assert desk.coordinator.asked[TRIES:] == [(name, False) for name in "abcd"]
    assert (desk.coordinator.taken, desk.left, len(desk.spool)) == (["a", "b", "d"], "", 1)
    assert caplog.messages == [
        "the coordinator fails at the result of c, which stays on disk: it is posted again in "
        "10 minutes, and by the next worker on this machine (it fails)"
    ]


def test_one_that_fails_among_those_that_cannot_be_used_is_tried_as_often(desk: Desk) -> None:
    desk.coordinator.errors = {"a": Invalid("no number"), "c": failing()}
    failures(desk, 1)
    # What came before it is done with.
    assert desk.left == "cd"
    failures(desk, TRIES - 2)
    desk.post()
    assert (desk.coordinator.taken, desk.left, len(desk.spool)) == (["b", "d"], "", 1)


def test_what_was_set_aside_comes_back_after_ten_minutes_and_has_five_tries_again(
    desk: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    desk.coordinator.errors = {name: failing() for name in "abcd"}
    failures(desk, TRIES - 1)
    desk.post()
    set_aside = desk.clock.now
    caplog.clear()
    desk.posting.bring_back(set_aside + ASIDE_SECONDS - 0.1)
    assert (desk.left, caplog.messages) == ("", [])
    desk.posting.bring_back(set_aside + ASIDE_SECONDS)
    assert desk.left == "abcd"
    assert caplog.messages == ["trying again to post 4 results that were set aside"]
    failures(desk, TRIES - 1)
    # Nothing is aside: nothing is said.
    caplog.clear()
    desk.posting.bring_back(set_aside + 2 * ASIDE_SECONDS)
    assert caplog.messages == []


def test_what_got_through_starts_anew_where_its_key_is_used_again(desk: Desk) -> None:
    """Keys of what a full disk did not take are used again."""
    batch = Batch(lease="l", fence=4, worker="w", keys=(-1,), results=({"instance": "x"},))
    for _ in range(2):
        desk.coordinator.errors = {"x": failing()}
        failures(desk, TRIES - 1, lambda: desk.posting.post(batch))
        desk.coordinator.errors = {}
        desk.posting.post(batch)
    assert desk.left == "abcd"
