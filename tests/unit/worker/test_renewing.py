"""Leases are renewed beside whatever the worker is waiting for, as long as it gets on."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from random import Random
from threading import Event
from typing import Any

import pytest

from rehyb.errors import Unreachable
from worker import renewing
from worker.leases import Leases
from worker.renewing import Renewals


class Coordinator:
    """Grants one lease of 0.03 s, and counts its renewals."""

    def __init__(self) -> None:
        self.renewals = 0
        self.away = 0

    def lease(self, **_: Any) -> dict[str, Any]:
        return {"id": "l", "fence": 7, "ttl_seconds": 0.03, "instances": [{"id": "a"}]}

    def renew(self, *_: Any) -> None:
        self.renewals += 1
        if self.away:
            self.away -= 1
            raise Unreachable("nobody there")


@pytest.fixture
def coordinator() -> Coordinator:
    return Coordinator()


@pytest.fixture
def renewals(coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch) -> Iterator[Renewals]:
    """Those of a worker that holds a lease, and whose own thread does nothing any more."""
    monkeypatch.setattr(renewing, "TICK_SECONDS", 0.002)
    monkeypatch.setattr("worker.backoff.BASE_SECONDS", 0.002)
    client: Any = coordinator
    leases = Leases(
        client=client, worker={}, models=lambda _: {"m": ""}, processes=1, batch=1, rng=Random(1)
    )
    request = leases.request(0.0)
    assert request is not None
    leases.ask(request, time.monotonic())
    renewals = Renewals(
        renew=partial(leases.renew, client), patience=leases.patience, rng=Random(1)
    )
    yield renewals
    renewals.close()


def within(seconds: float, ask: Callable[[], object]) -> bool:
    """Say whether the answer becomes true in time."""
    until = time.monotonic() + seconds
    while not ask() and time.monotonic() < until:
        time.sleep(0.001)
    return bool(ask())


def test_leases_are_renewed_while_the_worker_waits_for_something_else(
    renewals: Renewals, coordinator: Coordinator
) -> None:
    renewals.start()
    assert within(10.0, lambda: coordinator.renewals >= 3)
    renewals.close()
    told = coordinator.renewals
    Event().wait(0.05)
    assert coordinator.renewals == told


def test_a_coordinator_that_is_away_for_a_while_is_asked_again(
    renewals: Renewals, coordinator: Coordinator
) -> None:
    coordinator.away = 5
    renewals.start()
    assert within(10.0, lambda: coordinator.renewals >= 8)


def test_leases_that_are_short_are_tried_again_before_they_end(
    renewals: Renewals, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an outage a coordinator waits as long as a lease lives, and no longer."""
    monkeypatch.setattr("worker.backoff.BASE_SECONDS", 1e6)
    monkeypatch.setattr("worker.backoff.CAP_SECONDS", 1e6)
    coordinator.away = 5
    renewals.start()
    assert within(10.0, lambda: coordinator.renewals >= 8)


def test_a_worker_that_hangs_keeps_no_lease_until_it_gets_on_again(
    renewals: Renewals, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(renewing, "STUCK_SECONDS", 0.0)
    renewals.start()
    Event().wait(0.1)
    assert coordinator.renewals == 0
    monkeypatch.setattr(renewing, "STUCK_SECONDS", 60.0)
    renewals.progress()
    assert within(10.0, lambda: coordinator.renewals >= 3)


def test_what_never_began_ends_at_once(renewals: Renewals) -> None:
    renewals.close()
