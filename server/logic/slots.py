"""The life of one instance: pending -> leased -> done, with a budget for every cause of return.

A failed simulation is a result and final at once. What says more about the machine than about the
simulation (a crash, a time out, a report that makes no sense, silence) is tried again, each cause
on its own budget, so that a lost host does not use up the patience meant for crashes. What has
used up a budget on as many hosts is at fault itself: it is in quarantine, with the cause as its
final outcome. Where fewer hosts are at work it is tried as often on those there are.
"""

from collections.abc import Collection, Mapping
from dataclasses import field, replace
from typing import Any

from server.logic.records import record

#: On how many hosts an instance may come back for a cause; after the last one, the cause is its
#: final outcome.
BUDGETS: Mapping[str, int] = {"crashed": 3, "timed_out": 3, "invalid": 3, "lost": 5}
#: It comes back so many times the budget at most, however many hosts have not tried it.
PATIENCE = 2


@record
class Slot:
    """Where one instance stands."""

    row: int
    position: int
    #: "pending", "leased" or "done".
    state: str
    #: The lease that holds it; None unless leased.
    lease: str | None
    #: How often it came back, by cause.
    attempts: Mapping[str, int]
    #: The kind of machine its row is computed on; None while any may take it.
    host_class: str | None = None
    #: The host on which it last went wrong: another one is to try next, if there is one.
    avoid: str | None = None
    #: The hosts from which it came back, by cause, each once.
    hosts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def tried(self) -> set[str]:
        """The hosts on which it went wrong, for whatever cause."""
        return {host for hosts in self.hosts.values() for host in hosts}


@record
class Result:
    """The final result of one instance."""

    row: int
    position: int
    #: "ok" or the name of a failure.
    outcome: str
    #: The study's outputs; None unless `outcome` is "ok".
    outputs: Mapping[str, float] | None
    reason: str
    state: Mapping[str, Any] | None
    wall_seconds: float | None

    def same_as(self, other: "Result") -> bool:
        """Say whether both report the same; how long it took and in which words does not count."""
        return self.outcome == other.outcome and self.outputs == other.outputs


def settled(slot: Slot) -> Slot:
    """Return the slot with its final result in."""
    # As `replace` would, in half the time: every result comes by here.
    return Slot(
        row=slot.row,
        position=slot.position,
        state="done",
        lease=None,
        attempts=slot.attempts,
        host_class=slot.host_class,
        avoid=slot.avoid,
        hosts=slot.hosts,
    )


def handed_back(slot: Slot) -> Slot:
    """Return the slot of an instance its worker gave up unharmed: nothing is counted."""
    return replace(slot, state="pending", lease=None)


def reopened(slot: Slot, *, unbound: bool) -> Slot:
    """Return the slot as it was before it was first handed out; `unbound`: to any kind of machine.

    What went wrong before does not count against it.
    """
    host_class = None if unbound else slot.host_class
    return replace(
        slot,
        state="pending",
        lease=None,
        attempts={},
        host_class=host_class,
        avoid=None,
        hosts={},
    )


def may_try(slot: Slot, host: str, at_work: Collection[str]) -> bool:
    """Say whether an instance may go to `host` now, given the hosts of its class at work.

    It goes to hosts on which it has not gone wrong first, then to any but the last one.
    """
    others = set(at_work) - {host}
    if host not in slot.tried and host != slot.avoid:
        return True
    return not others - slot.tried and (slot.avoid != host or not others)


def _is_spent(count: int, hosts: Collection[str], budget: int, at_work: Collection[str]) -> bool:
    """Say whether an instance that came back `count` times, from `hosts`, has used its budget."""
    if count < budget or len(hosts) >= budget:
        return count >= budget
    return not set(at_work) - set(hosts) or count >= PATIENCE * budget


def after_attempt(
    slot: Slot,
    *,
    cause: str,
    reason: str,
    host: str | None = None,
    at_work: Collection[str] = (),
    state: Mapping[str, Any] | None = None,
    wall_seconds: float | None = None,
) -> tuple[Slot, Result | None]:
    """Count one attempt that ended for `cause`, a key of BUDGETS, on `host`.

    Args:
        slot: as it was.
        cause: why it came back.
        reason: the same in words.
        host: where it was; None if nobody knows.
        at_work: the hosts of its class that work on its study now.
        state: what the worker says of the simulation.
        wall_seconds: how long it took.

    Returns:
        The slot, pending again, and None; or, the budget spent, the slot done and its final result.
    """
    count = slot.attempts.get(cause, 0) + 1
    hosts = slot.hosts.get(cause, ())
    if host is not None and host not in hosts:
        hosts = (*hosts, host)
    counted = replace(
        slot,
        attempts={**slot.attempts, cause: count},
        avoid=host,
        hosts={**slot.hosts, cause: hosts} if hosts else slot.hosts,
    )
    if not _is_spent(count, hosts, BUDGETS[cause], at_work):
        return handed_back(counted), None
    final = Result(
        row=slot.row,
        position=slot.position,
        outcome=cause,
        outputs=None,
        reason=reason,
        state=state,
        wall_seconds=wall_seconds,
    )
    return settled(counted), final
