"""Who may speak for a lease, and how long it lasts. Only the coordinator's clock decides."""

from server.records import Lease
from server.states import LeaseState


def has_expired(lease: Lease, now: float) -> bool:
    """Say whether an open lease has run out."""
    return lease.state == LeaseState.OPEN and lease.expires_at <= now


def went_unheard(lease: Lease, *, last_seen: float, ttl: float) -> bool:
    """Say whether a lease that ran out was one of which its worker had never heard.

    Whoever holds a lease speaks of it at every third of its life. A worker that went on speaking,
    but not of this one, never got the answer that granted it.

    Args:
        lease: that ran out.
        last_seen: when its worker last said anything.
        ttl: seconds that a lease lasts from the last word about it.
    """
    return last_seen >= lease.expires_at - ttl / 2.0


def objection_to_renewal(lease: Lease | None, *, fence: int, now: float) -> str | None:
    """Say in a sentence why the bearer may not renew the lease; None if it may."""
    if lease is None:
        return "there is no such lease"
    if lease.fence != fence:
        return f"the fence of this lease is not {fence}"
    if lease.state != LeaseState.OPEN:
        return f"the lease is {lease.state}"
    if has_expired(lease, now):
        return f"the lease expired {now - lease.expires_at:.1f} s ago"
    return None


def objection_to_release(lease: Lease | None, *, fence: int) -> str | None:
    """Say in a sentence why the bearer may not release the lease; None if it may.

    Releasing what has already ended is allowed, so that a worker may repeat itself.
    """
    if lease is None:
        return "there is no such lease"
    if lease.fence != fence:
        return f"the fence of this lease is not {fence}"
    return None


def objection_to_results(lease: Lease, *, fence: int, worker: str) -> str | None:
    """Say in a sentence why the bearer may not post under the lease; None if it may.

    An ended lease is no objection: a late result of real work is still taken where there is none.
    """
    if lease.fence != fence:
        return f"the fence of this lease is not {fence}"
    if lease.worker != worker:
        return f"the lease does not belong to worker {worker}"
    return None


def expiry(now: float, ttl: float) -> float:
    """Return until when a lease lasts whose worker was heard from at `now`."""
    return now + ttl
