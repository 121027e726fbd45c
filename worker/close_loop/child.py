"""Closing the loop on one session, or interpreting it: what a worker's child does with such a job.

Whether a machine can is a matter of what is installed; a child loads it, and only when needed.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.running.outcomes import Outcome

if TYPE_CHECKING:
    from models.evaluation import Evaluation

#: Beside the archive: the report's files, and what the child is at.
OUT, PROGRESS = "out", "progress"


def can_close_loops() -> bool:
    """Say whether this installation can: a light one lacks what draws and writes the report."""
    return None not in map(find_spec, ("analysis.closeloop", "matplotlib", "jinja2"))


def work(job: Mapping[str, Any]) -> "Evaluation":
    """Close the loop on the zipped session `job["parameters"]["archive"]`, or interpret it.

    The report's files go beside the archive. To interpret it takes "bank", a file, and "options".

    Returns:
        Outcome "ok", of an interpretation with the state {"bank": id}, or "bad_session" with the
        state {"file", "column", "line"} of what is wrong.

    Raises:
        Exception: whatever else may go wrong; the pool calls it a crash.
    """
    from analysis.closeloop.errors import SessionError
    from models.evaluation import Evaluation
    from rehyb.client.states import JobKind
    from rehyb.errors import Invalid

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

    outcome, reason = Outcome.OK, ""
    state: dict[str, Any] | None = None
    try:
        if job["model"] == JobKind.INTERPRETATION:
            show("interpreting")
            state = {"bank": _interpret(job["parameters"], archive, folder / OUT)}
        else:
            _close(archive, folder / OUT, show)
    except (Invalid, SessionError) as error:
        outcome, reason = Outcome.BAD_SESSION, str(error)
        state = {name: getattr(error, name, None) for name in ("file", "column", "line")}
    seconds = time.perf_counter() - started
    return Evaluation(outcome=outcome, outputs={}, reason=reason, state=state, wall_seconds=seconds)


def _close(archive: Path, out: Path, show: Callable[[str], None]) -> None:
    from analysis.closeloop.loop import close_loop
    from analysis.closeloop.session.archive import unpacked

    with unpacked(archive) as session:
        close_loop(session, out, show)


def _interpret(parameters: Mapping[str, Any], archive: Path, out: Path) -> str:
    """Write an interpretation's report; return the bank's id."""
    from rehyb.interpretation import interpret_recording

    options = parameters["options"]
    known = [(one["name"], one["value"], one["sd"]) for one in options["known"]]
    out.mkdir()
    page = out / "report.html"
    found = interpret_recording(
        archive,
        Path(parameters["bank"]),
        known=known,
        tolerance=options["tolerance"],
        report=page,
    )
    if options["bank"] not in (None, found["bank"]):
        raise RuntimeError(f"the bank of this worker is {found['bank']}, not {options['bank']}")
    (out / "report.json").write_text(json.dumps(found, allow_nan=False), encoding="utf-8")
    return str(found["bank"])
