"""Why a table cannot be analysed."""


class GivenError(ValueError):
    """A table cannot be analysed; the message says what, where, and what would be right.

    Attributes:
        file: what the table is called.
        column, line: where the fault is, if it is in one place; the first line of a file is 1.
    """

    def __init__(
        self, sentence: str, *, file: str, column: str | None = None, line: int | None = None
    ) -> None:
        super().__init__(f"{file}: {sentence}")
        self.file = file
        self.column = column
        self.line = line
