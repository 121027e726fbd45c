"""Why a measured session cannot be used: one error, with file, column and line."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class SessionError(ValueError):
    """A session's folder says something that cannot be analysed; the message says what is right."""

    def __init__(
        self, detail: str, *, file: str, column: str | None = None, line: int | None = None
    ) -> None:
        where = file
        if column is not None:
            where += f", column {column}"
        if line is not None:
            where += f", line {line}"
        super().__init__(f"{where}: {detail}")
        self.detail = detail
        self.file = file
        self.column = column
        #: As an editor counts: the header is line 1.
        self.line = line


@contextmanager
def naming_unsolvable(file: str) -> Iterator[None]:
    """Within the block, equations that have no solution are a fault of the session.

    Args:
        file: what is named, since none is known to hold the number.

    Raises:
        SessionError: NumPy found none.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        why = (
            f"its equations have no solution ({error}): look in model and trials for a number far "
            "from what it measures; where there is none, it is a fault of rehyb to be reported"
        )
        raise SessionError(why, file=file) from error
