"""What is wrong with a trial, where its file shows it."""

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.contents import Trial


def fault(trial: Trial, why: str, column: str | None = None, row: int = 0) -> SessionError:
    """Return what is wrong at a sample, by its line in the file; one may hold several trials.

    Args:
        trial: whose sample it is.
        why: of the column, as in "is constant".
        column: None if it is all of them.
        row: of the trial's samples, from 0.
    """
    line = int(trial.lines[row]) if len(trial.lines) else row + 2
    whose = f"in the trial{trial.part}: " if trial.part else ""
    told = None if column is None else line
    return SessionError(f"{whose}{why}", file=trial.file, column=column, line=told)
