"""The life of one instance: pending -> leased -> done, with a budget for every cause of return.

A failed simulation is a result and final at once. What says more about the machine than about the
simulation (a crash, a time out, a report that makes no sense, silence) is tried again, each cause
on its own budget, so that a lost host does not use up the patience meant for crashes. What has
used up a budget on as many hosts is at fault itself: it is in quarantine, with the cause as its
final outcome. Where fewer hosts are at work it is tried as often on those there are.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from server.records import Instance, Place, Result
from server.states import InstanceState, Outcome

#: On how many hosts an instance may come back for a cause; after the last one, the cause is its
#: final outcome.
BUDGETS: Mapping[str, int] = {
    Outcome.CRASHED: 3,
    Outcome.TIMED_OUT: 3,
    Outcome.INVALID: 3,
    Outcome.LOST: 5,
}
#: Those of them that a worker may report; the others only the coordinator concludes.
RETRIED = (Outcome.CRASHED, Outcome.TIMED_OUT)
RESERVED = (Outcome.LOST, Outcome.INVALID)
#: Where an instance stands: whoever looks for those that stand so finds none that ended so.
STANDINGS = (*InstanceState, "quarantined")
#: Counted if a worker never heard that it was given the instance: of no budget, as the instance has
#: no part in it, but others are asked first.
UNHEARD = "unheard"
#: It comes back so many times the budget at most, however many hosts have not tried it.
PATIENCE = 2

# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_DONE, _PENDING = InstanceState.DONE, InstanceState.PENDING


def with_result(instance: Instance) -> Instance:
    """Return the instance with its final result in."""
    # As `replace` would, in half the time: every result comes by here.
    return Instance(
        row=instance.row,
        position=instance.position,
        state=_DONE,
        lease=None,
        attempts=instance.attempts,
        host_class=instance.host_class,
        avoid=instance.avoid,
        hosts=instance.hosts,
    )


def held(instances: Mapping[Place, Instance], *, lease: str) -> dict[Place, Instance]:
    """Return those of `instances` that a lease holds."""
    return {place: instance for place, instance in instances.items() if instance.lease == lease}


def handed_back(instance: Instance) -> Instance:
    """Return an instance that its worker gave up unharmed: nothing is counted."""
    return replace(instance, state=_PENDING, lease=None)


def unheard(instance: Instance, host: str) -> Instance:
    """Return an instance that was granted in an answer which got lost on its way to `host`."""
    return handed_back(_counted(instance, UNHEARD, host))


def reopened(instance: Instance, *, unbound: bool) -> Instance:
    """Return the instance as before it was handed out; `unbound`: to any kind of machine.

    What went wrong before does not count against it.
    """
    return Instance(
        row=instance.row,
        position=instance.position,
        state=_PENDING,
        lease=None,
        attempts={},
        host_class=None if unbound else instance.host_class,
    )


def may_try(instance: Instance, host: str, at_work: Collection[str]) -> bool:
    """Say whether an instance may go to `host` now, given the hosts of its class at work.

    It goes to hosts on which it has not gone wrong first, then to any but the last one.
    """
    others = set(at_work) - {host}
    if host not in instance.tried and host != instance.avoid:
        return True
    return not others - instance.tried and (instance.avoid != host or not others)


def _is_spent(count: int, hosts: Collection[str], budget: int, at_work: Collection[str]) -> bool:
    """Say whether an instance that came back `count` times, from `hosts`, has used its budget."""
    if count < budget or len(hosts) >= budget:
        return count >= budget
    return not set(at_work) - set(hosts) or count >= PATIENCE * budget


def after_attempt(
    instance: Instance,
    *,
    cause: str,
    reason: str,
    host: str | None = None,
    at_work: Collection[str] = (),
    state: Mapping[str, Any] | None = None,
    wall_seconds: float | None = None,
) -> tuple[Instance, Result | None]:
    """Count one attempt that ended for `cause`, a key of BUDGETS, on `host`.

    Args:
        host: where it was; None if nobody knows.
        at_work: the hosts of its class that work on its study now.
        state: what the worker says of the simulation.
        wall_seconds: how long it took.

    Returns:
        The instance, pending again, and None; or, the budget spent, done and with its final result.
    """
    counted = _counted(instance, cause, host)
    count, hosts = counted.attempts[cause], counted.hosts.get(cause, ())
    if not _is_spent(count, hosts, BUDGETS[cause], at_work):
        return handed_back(counted), None
    final = Result(
        row=instance.row,
        position=instance.position,
        outcome=cause,
        outputs=None,
        reason=reason,
        state=state,
        wall_seconds=wall_seconds,
    )
    return with_result(counted), final


def _counted(instance: Instance, cause: str, host: str | None) -> Instance:
    """Return an instance that came back once more for a cause, from `host` if anybody knows."""
    hosts = instance.hosts.get(cause, ())
    if host is not None and host not in hosts:
        hosts = (*hosts, host)
    return replace(
        instance,
        attempts={**instance.attempts, cause: instance.attempts.get(cause, 0) + 1},
        avoid=host,
        hosts={**instance.hosts, cause: hosts} if hosts else instance.hosts,
    )
