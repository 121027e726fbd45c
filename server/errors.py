"""Why the coordinator refuses, as one small tree; `server.http.problems` maps it to HTTP once."""

from analysis.sensitivity.records import NoSuchStudyError


class CoordinatorError(Exception):
    """The coordinator cannot do what was asked; the message says what and what would be right."""


class NotFoundError(CoordinatorError):
    """There is no such thing."""


class NoStudyError(NotFoundError, NoSuchStudyError):
    """There is no such study, in words that the analysis knows too."""


class ConflictError(CoordinatorError):
    """The request contradicts what is already so."""


class WrongPathError(ConflictError):
    """What a path leads to is not there, is not for this user, or is not what is taken."""


class OtherDatabaseError(WrongPathError):
    """The database is somebody else's: it has something, and not what rehyb has."""

    def __init__(self, found: str) -> None:
        super().__init__(f"the database is not rehyb's: {found}; name another file or database")
        #: What shows it, in words.
        self.found = found


class BadSettingError(CoordinatorError):
    """What an operator has set or typed cannot be."""


class InvalidStudyError(CoordinatorError):
    """A study cannot be drawn up from the request."""

    def __init__(self, pointer: str, detail: str) -> None:
        super().__init__(detail)
        #: Where in the request the fault lies, as an RFC 6901 JSON pointer.
        self.pointer = pointer


class BadFileError(CoordinatorError):
    """An uploaded session or model cannot be used, in the words of the command line."""

    def __init__(
        self, sentence: str, *, file: str, column: str | None = None, line: int | None = None
    ) -> None:
        super().__init__(sentence)
        self.file = file
        self.column = column
        #: As an editor counts: the header is line 1.
        self.line = line

    def to_json(self) -> dict[str, str | int | None]:
        """Return where the fault is, as members of a problem."""
        return {"file": self.file, "column": self.column, "line": self.line}


class SchemaError(CoordinatorError):
    """The database's schema is not the one this version works with."""


class OldSchemaError(SchemaError):
    """It is none, or an older one; the start of a coordinator of this version mends that."""


class DatabaseAwayError(CoordinatorError):
    """No database server is there, or it takes nobody yet or any more."""


class DamagedError(CoordinatorError):
    """The file of the database has pages that cannot be right."""
