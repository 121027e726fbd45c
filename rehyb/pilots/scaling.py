"""How many pilots to start and to let go: a decision without a clock or a batch system."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil

from rehyb.pilots.engines import JobState

#: Pilots that start in the same second would all ask for work in the same moment.
STARTS_A_SECOND = 5.0


@dataclass(frozen=True, kw_only=True)
class Work:
    """What a coordinator has to do."""

    #: Instances that could be handed out now.
    waiting: int
    #: Instances that workers have.
    under_way: int


@dataclass(frozen=True, kw_only=True)
class Step:
    """What to do now."""

    #: How many pilots should be there.
    wanted: int
    #: How many to submit.
    submit: int
    #: Jobs to cancel, none of which has begun.
    cancel: tuple[str, ...]


def step(
    work: Work,
    jobs: Mapping[str, JobState],
    *,
    cores: int,
    minimum: int,
    maximum: int,
    may_start: int,
) -> Step:
    """Decide on the next step.

    Pilots that run are never cancelled: those without work leave by themselves, and those with work
    are wanted.

    Args:
        jobs: where every job is that has not ended, in the order in which they were submitted.
        cores: of a pilot.
        may_start: how many pilots may be submitted now.
    """
    wanted = min(maximum, max(minimum, ceil((work.waiting + work.under_way) / cores)))
    waiting = [job for job, state in jobs.items() if state == JobState.WAITING]
    running = len(jobs) - len(waiting)
    # Who came last has waited least.
    spare = max(0, len(waiting) - max(0, wanted - running))
    cancel = tuple(reversed(waiting))[:spare]
    # What is under way has a worker: a new pilot is for what waits.
    missing = max(0, wanted - len(jobs)) if work.waiting or len(jobs) < minimum else 0
    return Step(wanted=wanted, submit=min(missing, max(0, may_start)), cancel=cancel)


def may_start(starts: Sequence[float], *, now: float, a_minute: int) -> int:
    """Return how many pilots may be submitted now; `starts`: when others were."""
    return max(0, a_minute - sum(start > now - 60.0 for start in starts))


def head_start(number: int) -> float:
    """Return the seconds that the `number`-th pilot of those submitted together waits."""
    return number / STARTS_A_SECOND
