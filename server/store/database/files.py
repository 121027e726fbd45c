"""The files of SQLite databases, in which measured sessions of people are."""

import os
from contextlib import suppress
from pathlib import Path


def make_private(path: Path) -> None:
    """Make a file that only its owner may read, unless it is there; SQLite's log is as its file.

    What keeps it from being made is said by whoever opens it then.
    """
    # One that is there is not even opened: to close it again would end SQLite's locks on it.
    with suppress(OSError):
        os.close(os.open(os.path.realpath(path), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
