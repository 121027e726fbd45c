"""The life of one instance: pending -> leased -> done, with a budget for every cause of return.

A failed simulation is a result and final at once. What says more about the machine than about the
simulation (a crash, a time out, a report that makes no sense, silence) is tried again, each cause
on its own budget, so that a lost host does not use up the patience meant for crashes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

#: How often an instance may come back for a cause; the last time, the cause is its final outcome.
BUDGETS: Mapping[str, int] = {"crashed": 3, "timed_out": 3, "invalid": 3, "lost": 5}


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
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
    return replace(slot, state="done", lease=None)


def handed_back(slot: Slot) -> Slot:
    """Return the slot of an instance its worker gave up unharmed: nothing is counted."""
    return replace(slot, state="pending", lease=None)


def reopened(slot: Slot, *, unbound: bool) -> Slot:
    """Return the slot as it was before it was first handed out; `unbound`: to any kind of machine.

    What went wrong before does not count against it.
    """
    host_class = None if unbound else slot.host_class
    return replace(
        slot, state="pending", lease=None, attempts={}, host_class=host_class, avoid=None
    )


def after_attempt(
    slot: Slot,
    *,
    cause: str,
    reason: str,
    host: str | None = None,
    state: Mapping[str, Any] | None = None,
    wall_seconds: float | None = None,
) -> tuple[Slot, Result | None]:
    """Count one attempt that ended for `cause`, a key of BUDGETS, on `host`.

    Returns:
        The slot, pending again, and None; or, the budget spent, the slot done and its final result.
    """
    count = slot.attempts.get(cause, 0) + 1
    counted = replace(slot, attempts={**slot.attempts, cause: count}, avoid=host)
    if count < BUDGETS[cause]:
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
