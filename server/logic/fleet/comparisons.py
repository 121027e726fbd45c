"""Second opinions: a share of the results is computed again on another host and compared.

They are extra work and never results: what comes out changes no index, only how far the hosts are
trusted. Of two results that disagree nobody knows the wrong one, so it counts against both hosts;
the host that is at fault will be found in most of the disagreements.
"""

import hashlib
from dataclasses import dataclass, replace

from server.logic.study.instances import BUDGETS
from server.records import Comparison, Lease, Result
from server.states import ComparisonState

#: How often a second opinion may fail to come before nobody is asked any more.
ATTEMPTS = 3
#: So long they gather while there is other work: a host is asked for many at once.
GATHER_SECONDS = 5.0
#: Outputs smaller than this (SI units) are compared as if they were as large: what is left when
#: two large numbers cancel has no digits to compare.
LEAST = 1e-3


@dataclass(frozen=True, kw_only=True)
class Reputation:
    """How a host came out of its comparisons, as the first and as the second."""

    agreed: int = 0
    disagreed: int = 0

    @property
    def trust(self) -> float:
        """Share of its comparisons that agreed, counting one that nobody made: 1 for a stranger."""
        return (self.agreed + 1) / (self.agreed + self.disagreed + 1)


def is_chosen(seed: int, row: int, position: int, share: float) -> bool:
    """Say whether an instance of the study with this seed is among the `share` computed twice."""
    digest = hashlib.blake2b(f"{seed}:{row}:{position}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") < share * 2.0**64


def is_comparable(result: Result) -> bool:
    """Say whether a result is about the simulation; a crash says more about the machine."""
    return result.outcome not in BUDGETS


def difference(first: Result, second: Result) -> float | None:
    """Return the largest relative difference of two results' outputs; None: other outcomes."""
    if first.outcome != second.outcome:
        return None
    ours, theirs = first.outputs or {}, second.outputs or {}
    return max(
        (
            abs(ours[name] - theirs[name]) / max(abs(ours[name]), abs(theirs[name]), LEAST)
            for name in ours
        ),
        default=0.0,
    )


def agree(first: Result, second: Result, tolerance: float) -> bool:
    """Say whether two results of one instance are the same within a relative `tolerance`."""
    apart = difference(first, second)
    return apart is not None and apart <= tolerance


def put_back(asked: Comparison, *, counted: bool = True) -> Comparison:
    """Return a second opinion that failed to come; `counted`: its worker is at fault."""
    attempts = asked.attempts + counted
    spent = attempts >= ATTEMPTS
    state = ComparisonState.ABANDONED if spent else ComparisonState.WAITING
    return replace(asked, state=state, attempts=attempts, lease_id=None)


def concluded(
    asked: Comparison, first: Result, second: Result, lease: Lease, *, tolerance: float, now: float
) -> Comparison:
    """Return a second opinion that has come under `lease`; see `agree`."""
    agreed = agree(first, second, tolerance)
    return replace(
        asked,
        state=ComparisonState.AGREED if agreed else ComparisonState.DISAGREED,
        decided_at=now,
        second_host=lease.host,
        second_worker_id=lease.worker,
        outcome=second.outcome,
        outputs=second.outputs,
        difference=difference(first, second),
    )
