"""Analyse a stranger's table in a process of its own, and print the answer as one line of JSON.

`python -m analysis.given.check FILE --wanted '{"outputs": ["y"], "factors": null}'`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from analysis.given.answer import analyse
from analysis.given.table.refusals import GivenError
from intake.looks import look


def check(file: Path, wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Return `analysis.given.answer.analyse` of a file.

    Raises:
        GivenError: it cannot be analysed.
    """
    try:
        return analyse(file, wanted.get("outputs") or (), wanted.get("factors"))
    except ModuleNotFoundError as error:
        raise GivenError(
            f"the coordinator cannot analyse it without {error.name}: pip install 'rehyb[given]'",
            file=file.name,
        ) from None


if __name__ == "__main__":
    look(check, GivenError, lambda detail, file: GivenError(detail, file=file))
