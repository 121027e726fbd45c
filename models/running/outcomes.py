"""How what a child process is given may end, an instance or a close-loop job."""

from enum import StrEnum


class Outcome(StrEnum):
    """Outcomes that whoever runs it tells apart; a simulation has names of its own beside."""

    OK = "ok"
    #: The child process died, or raised an exception.
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    #: An output is not a finite number.
    NOT_FINITE = "not_finite"
    #: What evaluates the model cannot be had, or not be loaded.
    BAD_MODEL = "bad_model"
    #: What evaluates the model does not answer; no model can call a failure so, and no coordinator
    #: is told: whoever reaches it takes the instance.
    AWAY = "(away)"
    #: A close-loop job: the session cannot be analysed.
    BAD_SESSION = "bad_session"
