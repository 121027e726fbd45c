"""The program that looks at a stranger's file: under limits, with one line of JSON as answer."""

import argparse
import json
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: Characters kept of a sentence that quotes a stranger's file.
SENTENCE_LENGTH = 2000


def look(
    check: Callable[..., Any],
    refusal: type[Exception],
    refuse: Callable[[str, str], Exception],
) -> None:
    """Check the file named on the command line and print {"answer": ...} or {"error": ...}.

    Args:
        check: returns what is understood of a file, as JSON; takes its path and, if the command
            line says what is `--wanted`, that.
        refusal: what it raises if the file cannot be used; it has `file`, and may have `column`
            and `line`.
        refuse: makes one of a sentence and a file's name.
    """
    parser = argparse.ArgumentParser(description="Say whether a file can be used.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--memory-mb", type=int, default=4096)
    parser.add_argument("--seconds", type=int, default=300, help="of processor time")
    parser.add_argument("--wanted", type=json.loads, help="what of it, as JSON")
    arguments = parser.parse_args()
    wanted = () if arguments.wanted is None else (arguments.wanted,)
    # Before anything of the file is read.
    limit(arguments.memory_mb, arguments.seconds)
    try:
        answer = {"answer": check(arguments.file, *wanted)}
    except refusal as error:
        answer = {"error": _said(error)}
    except MemoryError:
        what = f"takes more than {arguments.memory_mb} MB of memory to read"
        answer = {"error": _said(refuse(what, arguments.file.name))}
    json.dump(answer, sys.stdout)


def limit(memory_mb: int, seconds: int) -> None:
    """Let this process have so much memory (MB) and processor time (s), and write no core file."""
    resource.setrlimit(resource.RLIMIT_DATA, (memory_mb * 2**20, memory_mb * 2**20))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _said(error: Any) -> dict[str, Any]:
    column = getattr(error, "column", None)
    return {
        "sentence": _cut(str(error)),
        "file": _cut(error.file),
        "column": None if column is None else _cut(column),
        "line": getattr(error, "line", None),
    }


def _cut(text: str) -> str:
    """Return text from a stranger's file, shortened and safe to store and print."""
    return text[:SENTENCE_LENGTH].encode(errors="backslashreplace").decode().replace("\0", " ")
