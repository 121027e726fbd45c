"""How an instance or a close-loop job may end, and what the coordinator says of a result."""

from enum import StrEnum


class Outcome(StrEnum):
    """Outcomes that the worker itself tells apart; a simulation has names of its own beside."""

    OK = "ok"
    #: The child process died, or raised an exception.
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    #: An output is not a finite number.
    NOT_FINITE = "not_finite"
    #: What evaluates the model cannot be had, or not be loaded.
    BAD_MODEL = "bad_model"
    #: A close-loop job: the session cannot be analysed.
    BAD_SESSION = "bad_session"


class Verdict(StrEnum):
    """Verdicts of the coordinator with which a result is where it belongs."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
