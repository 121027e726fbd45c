"""Closing the loop on one session: what a child process of the worker does with such a job.

Whether a machine can is a matter of what is installed; a child loads it, and only when needed.
"""

import os
import tempfile
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from worker.outcomes import Outcome

if TYPE_CHECKING:
    from models.evaluation import Evaluation

#: Beside the archive: the report's files, and what the child is at.
OUT, PROGRESS = "out", "progress"


def can_close_loops() -> bool:
    """Say whether this installation can: a light one lacks what draws and writes the report."""
    return None not in map(find_spec, ("analysis.closeloop", "matplotlib", "jinja2"))


def close(job: Mapping[str, Any]) -> "Evaluation":
    """Close the loop on the zipped session `job["parameters"]["archive"]`; files go beside it.

    Returns:
        Outcome "ok", or "bad_session" with the state {"file", "column", "line"} of what is wrong.

    Raises:
        Exception: whatever else may go wrong; the pool calls it a crash.
    """
    from analysis.closeloop.errors import SessionError
    from analysis.closeloop.loop import close_loop
    from analysis.closeloop.session.archive import unpacked
    from models.evaluation import Evaluation

    archive = Path(job["parameters"]["archive"])
    folder = archive.parent
    # What is left behind by whatever ends this process is in one folder, which the parent removes.
    os.chdir(folder)
    tempfile.tempdir = str(folder)
    started = time.perf_counter()

    def show(stage: str) -> None:
        # At once as a whole: the parent reads it any time.
        fresh = folder / f"{PROGRESS}.fresh"
        fresh.write_text(stage, encoding="utf-8")
        fresh.replace(folder / PROGRESS)

    try:
        with unpacked(archive) as session:
            close_loop(session, folder / OUT, show)
    except SessionError as error:
        return Evaluation(
            outcome=Outcome.BAD_SESSION,
            outputs={},
            reason=str(error),
            state={"file": error.file, "column": error.column, "line": error.line},
            wall_seconds=time.perf_counter() - started,
        )
    return Evaluation(outcome=Outcome.OK, outputs={}, wall_seconds=time.perf_counter() - started)
