"""Who is served together."""

from typing import Any

from server.operations.fleet.exchange import Exchange, LeaseRequest, Post
from server.operations.fleet.turns import MOST, MOST_INSTANCES, next_turn
from server.records import Introduction
from tests.testbed.coordinators.records import report


def waits(study: str = "", brings: int = 0, asks: int = 0) -> Any:
    worker = Introduction(id="w", host="h", versions={})
    request = LeaseRequest(worker=worker, models=["ishigami"], max_instances=asks)
    reports = [report(f"{study}:{row}:0") for row in range(brings)]
    posted = Post(reports=reports, lease="l", fence=1, worker="w", share=0.0, tolerance=0.0)
    return None, Exchange(
        now=0.0, ttl=60.0, posted=posted if brings else None, request=request if asks else None
    )


def test_a_turn_serves_who_brings_results_of_its_study_or_none_first_come_first() -> None:
    queue = [waits("a1", brings=1), waits("b2", brings=1), waits(asks=1), waits("a1", brings=2)]
    assert next_turn(queue, "a1") == ([queue[0], queue[2], queue[3]], [queue[1]])
    many = [waits(asks=1) for _ in range(MOST + 1)]
    assert next_turn(many, "a1") == (many[:MOST], many[MOST:])


def test_large_requests_do_not_wait_for_each_other() -> None:
    large = [waits("a1", brings=100, asks=320) for _ in range(4)]
    assert next_turn(large, "a1") == (large[:2], large[2:])
    larger = [waits(asks=2 * MOST_INSTANCES), waits(asks=1)]
    assert next_turn(larger, "") == (larger[:1], larger[1:])
