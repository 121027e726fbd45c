"""States that a coordinator answers with: those of `server.states`, which no client imports."""

from enum import StrEnum


class StudyState(StrEnum):
    """Where a study stands."""

    RUNNING = "running"
    #: Begun rows are finished, none is begun; then it is paused.
    DRAINING = "draining"
    PAUSED = "paused"
    COMPLETE = "complete"
    CANCELLED = "cancelled"


class JobKind(StrEnum):
    """What is done with a measured session."""

    CLOSE_LOOP = "close-loop"
    #: Of a wearer: K_h with an interval.
    INTERPRETATION = "interpretation"


class JobState(StrEnum):
    """Where a job on a session stands, whatever its kind."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
