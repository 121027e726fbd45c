"""Why a measured session cannot be used: one error, with file, column and line."""


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
