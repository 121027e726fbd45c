"""Who may speak for a lease, and how long it lasts. Only the coordinator's clock decides."""

from server.logic.records import record


@record
class Lease:
    """The right of one worker to evaluate some instances of one study until a moment."""

    id: str
    #: Grows with every lease granted; a worker must show it along with the id.
    fence: int
    worker: str
    study: str
    #: "open", "finished" (it holds nothing any more), "released" or "expired".
    state: str
    expires_at: float
    #: (row, position) of every instance handed out with it.
    instances: tuple[tuple[int, int], ...]
    #: The kind of machine its worker was when it was granted.
    host_class: str | None = None
    #: Where its worker ran when it last asked for work.
    host: str = ""
    #: Whether it asks for second opinions on results that are there already.
    compares: bool = False


def has_expired(lease: Lease, now: float) -> bool:
    """Say whether an open lease has run out."""
    return lease.state == "open" and lease.expires_at <= now


def objection_to_renewal(lease: Lease | None, *, fence: int, now: float) -> str | None:
    """Say in a sentence why the bearer may not renew the lease; None if it may."""
    if lease is None:
        return "there is no such lease"
    if lease.fence != fence:
        return f"the fence of this lease is not {fence}"
    if lease.state != "open":
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

    An ended lease is no objection: a late result of real work still fills an empty slot.
    """
    if lease.fence != fence:
        return f"the fence of this lease is not {fence}"
    if lease.worker != worker:
        return f"the lease does not belong to worker {worker}"
    return None


def expiry(now: float, ttl: float) -> float:
    """Return until when a lease lasts whose worker was heard from at `now`."""
    return now + ttl
