"""Who may speak for a lease, and how long it lasts."""

from dataclasses import replace

import pytest

from server.logic.fleet.leases import (
    expiry,
    has_expired,
    objection_to_release,
    objection_to_renewal,
    objection_to_results,
    went_unheard,
)
from server.records import Lease

LEASE = Lease(
    id="L",
    fence=7,
    worker="w",
    study="s",
    state="open",
    expires_at=100.0,
    instances=((0, 0),),
)
RELEASED = replace(LEASE, state="released")
EXPIRED = replace(LEASE, state="expired")


@pytest.mark.parametrize(
    ("lease", "now", "expired"),
    [(LEASE, 99.9, False), (LEASE, 100.0, True), (RELEASED, 200.0, False)],
)
def test_a_lease_expires_at_its_moment_unless_it_ended_before(
    lease: Lease, now: float, expired: bool
) -> None:
    assert has_expired(lease, now) is expired


@pytest.mark.parametrize(
    ("lease", "fence", "now", "says"),
    [
        (LEASE, 7, 99.0, None),
        (None, 7, 99.0, "there is no such lease"),
        (LEASE, 6, 99.0, "the fence of this lease is not 6"),
        (LEASE, 7, 102.5, "the lease expired 2.5 s ago"),
        (RELEASED, 7, 99.0, "the lease is released"),
        (EXPIRED, 7, 99.0, "the lease is expired"),
    ],
)
def test_only_the_holder_of_a_living_lease_renews_it(
    lease: Lease | None, fence: int, now: float, says: str | None
) -> None:
    assert objection_to_renewal(lease, fence=fence, now=now) == says


@pytest.mark.parametrize(
    ("lease", "fence", "says"),
    [
        (LEASE, 7, None),
        (RELEASED, 7, None),
        (EXPIRED, 7, None),
        (None, 7, "there is no such lease"),
        (LEASE, 8, "the fence of this lease is not 8"),
    ],
)
def test_a_release_may_be_repeated_but_not_forged(
    lease: Lease | None, fence: int, says: str | None
) -> None:
    assert objection_to_release(lease, fence=fence) == says


@pytest.mark.parametrize(
    ("lease", "fence", "worker", "says"),
    [
        (LEASE, 7, "w", None),
        (EXPIRED, 7, "w", None),
        (LEASE, 8, "w", "the fence of this lease is not 8"),
        (LEASE, 7, "v", "the lease does not belong to worker v"),
    ],
)
def test_results_may_come_late_but_not_from_somebody_else(
    lease: Lease, fence: int, worker: str, says: str | None
) -> None:
    assert objection_to_results(lease, fence=fence, worker=worker) == says


@pytest.mark.parametrize(
    ("last_seen", "unheard"),
    [(0.0, False), (20.0, False), (29.9, False), (30.0, True), (60.0, True), (61.0, True)],
)
def test_a_worker_that_spoke_in_the_last_half_of_a_lease_but_not_of_it_never_heard_of_it(
    last_seen: float, unheard: bool
) -> None:
    lease = replace(LEASE, expires_at=60.0)
    assert went_unheard(lease, last_seen=last_seen, ttl=60.0) is unheard


def test_a_lease_lasts_a_ttl_from_the_last_word() -> None:
    assert expiry(50.0, 60.0) == 110.0
