"""States and outcomes, each in one place; what is stored and sent is their value."""

from enum import StrEnum


class StudyState(StrEnum):
    """Where a study stands."""

    RUNNING = "running"
    #: Begun rows are finished, none is begun; then it is paused.
    DRAINING = "draining"
    PAUSED = "paused"
    COMPLETE = "complete"
    CANCELLED = "cancelled"

    @property
    def is_served(self) -> bool:
        """Whether workers are given instances of it."""
        return self in (StudyState.RUNNING, StudyState.DRAINING)

    @property
    def has_ended(self) -> bool:
        """Whether it gets no more results, unless somebody extends or reruns it."""
        return self in (StudyState.COMPLETE, StudyState.CANCELLED)


class InstanceState(StrEnum):
    """Where an instance of a begun row stands."""

    PENDING = "pending"
    LEASED = "leased"
    DONE = "done"


class LeaseState(StrEnum):
    """Where a lease stands."""

    OPEN = "open"
    #: It holds nothing any more.
    FINISHED = "finished"
    RELEASED = "released"
    EXPIRED = "expired"


class ComparisonState(StrEnum):
    """What has come of a second opinion."""

    WAITING = "waiting"
    LEASED = "leased"
    AGREED = "agreed"
    DISAGREED = "disagreed"
    #: It failed to come too often.
    ABANDONED = "abandoned"


class JobKind(StrEnum):
    """What is done with a measured session."""

    CLOSE_LOOP = "close-loop"
    #: Of a wearer: K_h with an interval.
    INTERPRETATION = "interpretation"


class CloseLoopState(StrEnum):
    """Where a job on a session stands, whatever its kind."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"

    @property
    def has_ended(self) -> bool:
        """Whether it changes no more."""
        return self in (CloseLoopState.DONE, CloseLoopState.FAILED)


class Verdict(StrEnum):
    """What the coordinator says of a result or report that a worker hands in."""

    ACCEPTED = "accepted"
    #: It is there already, or its attempt no longer counts.
    DUPLICATE = "duplicate"
    #: It contradicts the stored one.
    CONFLICT = "conflict"
    #: There is no such lease, or the lease does not hold the instance.
    UNKNOWN = "unknown"
    INVALID = "invalid"


#: The verdicts with which a result is turned away.
REFUSALS = frozenset({Verdict.CONFLICT, Verdict.UNKNOWN, Verdict.INVALID})


class Outcome(StrEnum):
    """How an attempt ended, as far as the coordinator knows its name.

    Every other outcome of an instance is the name of a failure that its model gives.
    """

    OK = "ok"
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    #: What the worker reported made no sense.
    INVALID = "invalid"
    #: The worker fell silent.
    LOST = "lost"
    #: The measured session cannot be analysed; no other machine could.
    BAD_SESSION = "bad_session"
