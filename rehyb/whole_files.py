"""Write files so that nobody finds half of one."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import Any

from rehyb.errors import Invalid


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a path to write to: it is renamed to `path` when the block succeeds, else removed.

    Where `path` is a link, what it leads to is written.

    Raises:
        Invalid: there is something that is no regular file: to rename to it would replace it.
        OSError: it cannot be written; it names `path`, whatever the block wrote to.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise Invalid(f"{path} is no regular file; name a file")
    # Of its own: two commands that write one file would else share it, and mix.
    partial = target.with_name(f"{target.name}.{token_hex(4)}.partial")
    try:
        # What keeps it from being made is said before anything is computed for it.
        partial.open("wb").close()
        yield partial
        partial.replace(target)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(partial)):
            raise
        # Those who write to it put the cause into words of their own, or name no file.
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    finally:
        # It may be what keeps it from being made.
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def make_folder(path: Path, what: str) -> None:
    """Make a folder, unless it is there.

    Args:
        path: of the folder.
        what: who keeps things there, as "a fleet".

    Raises:
        Invalid: it is a file, or lies in one.
        OSError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise Invalid(
            f"{error.filename} is no folder, which {what} needs for what it keeps: name one, "
            "or one to be made"
        ) from None


def write_json(path: Path, content: Any) -> None:
    """Write JSON, indented by two.

    Raises:
        ValueError: it holds a number that JSON does not have.
    """
    with whole_file(path) as partial:
        partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
