"""What a client asks a coordinator about jobs on sessions, and a worker about its own."""

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from errno import ENOTDIR
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from rehyb.client.connection import Connection, Json, as_path, path_of
from rehyb.client.packing import packed, plain_name
from rehyb.client.states import JobKind, JobState
from rehyb.client.studies import POLL_SECONDS
from rehyb.errors import Invalid, RehybError

if TYPE_CHECKING:
    from rehyb.client import Client

#: What a coordinator adds to an answer.
_OF_JOB = ("id", "session_id", "state")
#: Where the jobs of a kind are.
CLOSE_LOOPS, INTERPRETATIONS = "close-loops", "interpretations"


class CloseLoops(Connection):
    """Jobs that close the loop on a session or interpret it, and their reports."""

    def close_loop(self, session_id: str) -> Json:
        """Have a worker close the loop on a session; asking again finds the same job."""
        return self._json("POST", path_of("sessions", session_id, "close-loop"))

    def interpret(
        self,
        session_id: str,
        *,
        known: Iterable[tuple[str, float, float]] = (),
        tolerance: float | None = None,
        bank: str | None = None,
    ) -> Json:
        """Have a worker with a bank say K_h of a session's wearer with intervals.

        Asking the same again finds the same job. `wait_for_report` with `INTERPRETATIONS` returns
        the answer (docs/use/interpretation.md).

        Args:
            session_id: of a measured session.
            known: what was measured on the wearer: factor, value and standard deviation, SI units.
            tolerance: half width of K's 90 % interval that is wanted, Nm/rad.
            bank: its id; default: that of any worker.
        """
        measured = [{"name": name, "value": value, "sd": sd} for name, value, sd in known]
        body = {"known": measured, "tolerance": tolerance, "bank": bank}
        return self._json("POST", path_of("sessions", session_id, "interpretation"), body)

    def interpretation_file(self, interpretation_id: str, file: str, path: Path | str) -> None:
        """Write "report.json" or "report.html" of an interpretation to `path`."""
        self._download(path_of(INTERPRETATIONS, interpretation_id, file), path)

    def close_loop_report(self, close_loop_id: str) -> Json:
        """Return a job's report; before it is there ("state" is not "done"), how far the job is."""
        return self._json("GET", path_of(CLOSE_LOOPS, close_loop_id))

    def close_loop_file(self, close_loop_id: str, file: str, path: Path | str) -> None:
        """Write one of the REPORT_FILES of `analysis.closeloop.contract` to `path`."""
        self._download(path_of(CLOSE_LOOPS, close_loop_id, file), path)

    def wait_for_report(
        self,
        job_id: str,
        place: str = CLOSE_LOOPS,
        *,
        on_progress: Callable[[Json], None] = lambda standing: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Json:
        """Block until a job is done or has failed and return its report.

        Args:
            job_id: of what `close_loop` or `interpret` returned.
            place: CLOSE_LOOPS or INTERPRETATIONS.
            on_progress: called with what each look but the last finds.
            sleep: for tests.
        """
        while True:
            standing = self._json("GET", path_of(place, job_id))
            if standing["state"] in (JobState.DONE, JobState.FAILED):
                return standing
            on_progress(standing)
            sleep(POLL_SECONDS)

    def lease_close_loop(self, worker: Mapping[str, Any], bank: str | None = None) -> Json | None:
        """Lease a job {"id", "kind", "options", "lease", "fence", "ttl_seconds", "session"}.

        None (and `retry_after` set) if there is none. With a bank, its id, it may be to interpret.
        """
        # A coordinator of before there were banks knows of none.
        body = {"worker": worker} | ({} if bank is None else {"bank": bank})
        return self._leased("/v1/close-loops/lease", body)

    def renew_close_loop(self, job: Mapping[str, Any], progress: str | None) -> Json:
        """Renew a leased job and send its progress; Conflict or NotFound if the lease is lost."""
        body = {"lease": job["lease"], "fence": job["fence"], "progress": progress}
        return self._json("POST", path_of(CLOSE_LOOPS, job["id"], "renew"), body)

    def release_close_loop(self, job: Mapping[str, Any]) -> None:
        """Give a leased job back."""
        body = {"lease": job["lease"], "fence": job["fence"]}
        self._request("POST", path_of(CLOSE_LOOPS, job["id"], "release"), body)

    def fail_close_loop(
        self,
        job: Mapping[str, Any],
        *,
        worker: str,
        outcome: str,
        reason: str,
        where: Mapping[str, Any] | None = None,
    ) -> Json:
        """Say why a leased job has no report.

        Args:
            outcome: "bad_session", "crashed" or "timed_out".
            where: {"file", "column", "line"} of what is wrong with the session.
        """
        proof = {"lease": job["lease"], "fence": job["fence"], "worker": worker}
        body = {**proof, "outcome": outcome, "reason": reason, **(where or {})}
        return self._json("POST", path_of(CLOSE_LOOPS, job["id"], "failure"), body)

    def hand_in_report(
        self, job: Mapping[str, Any], folder: Path | str, *, worker: str, code: str
    ) -> Json:
        """Hand in the files in `folder` as a leased job's report; `code` made them."""
        from analysis.closeloop.contract import REPORT_FILES
        from analysis.interpretation.contract import REPORT_FILES as INTERPRETATION_FILES

        interprets = job.get("kind") == JobKind.INTERPRETATION

        proof = {"lease": job["lease"], "fence": job["fence"], "worker": worker, "code": code}
        path = path_of(CLOSE_LOOPS, job["id"], "report") + f"?{urlencode(proof)}"
        with ExitStack() as stack:
            files = {
                name: (name, stack.enter_context((as_path(folder) / name).open("rb")))
                for name in (INTERPRETATION_FILES if interprets else REPORT_FILES)
            }
            return self._post(path, files=files)


def close_loop_by_worker(
    client: "Client",
    session: Path,
    out: Path,
    progress: Callable[[str], None],
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, Any]:
    """Have a worker close the loop on a session and write the report's files to `out`.

    The same session again finds the report that is there already.

    Args:
        session: a folder with session.json, or its zip file.
        out: a folder; nothing is there unless the report is.
        progress: called with a line about each new stage.

    Returns:
        The content of report.json.

    Raises:
        Invalid: the session cannot be analysed; the message names file, column and line.
        RehybError: the coordinator does not answer, or no worker came to an end with it.
        OSError: `out` cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(ENOTDIR, "is a file, not a folder for the report", str(out))
    job = client.close_loop(_uploaded(client, session, progress))
    _ended(client, job["id"], CLOSE_LOOPS, progress, sleep)
    return _fetched(client, job["id"], out)


def interpret_by_worker(
    client: "Client",
    session: Path,
    *,
    known: Iterable[tuple[str, float, float]] = (),
    tolerance: float | None = None,
    report: Path | None = None,
    progress: Callable[[str], None] = lambda stage: None,
    answered: Callable[[Json], None] = lambda found: None,
) -> Json:
    """Have a worker with a bank interpret a session, and return its answer.

    Args:
        client: of the coordinator.
        session: a folder with session.json, or its zip file.
        known: as of `CloseLoops.interpret`.
        tolerance: as of `CloseLoops.interpret`.
        report: an HTML page to write.
        progress: called with a line about each new stage.
        answered: called with the answer before the report is written.

    Raises:
        Invalid: the session or what is known cannot be used; one sentence.
        RehybError: the coordinator does not answer, or no worker came to an end with it.
        OSError: the report cannot be written.
    """
    if session.suffix == ".npz":
        raise Invalid(
            f"{session}: a worker interprets a measured session (a folder with session.json, or "
            "its zip); leave --submit out, and this machine interprets the file"
        )
    uploaded = _uploaded(client, session, progress)
    job = client.interpret(uploaded, known=known, tolerance=tolerance)
    ended = _ended(client, job["id"], INTERPRETATIONS, progress)
    found = {name: value for name, value in ended.items() if name not in _OF_JOB}
    answered(found)
    if report is not None:
        client.interpretation_file(job["id"], "report.html", report)
    return found


def _uploaded(client: "Client", session: Path, progress: Callable[[str], None]) -> str:
    """Upload a session, a folder or its zip file, and return its id."""
    progress("uploading")
    with packed(session) as archive:
        kept = client.upload_session(archive, plain_name(session.resolve().stem)[:60])
    return str(kept["id"])


def _ended(
    client: "Client",
    job_id: str,
    place: str,
    progress: Callable[[str], None],
    sleep: Callable[[float], None] = time.sleep,
) -> Json:
    """Follow a job to its end and return its report; raises as those who call it."""
    shown = ""

    def follow(standing: Json) -> None:
        nonlocal shown
        stage = standing.get("note") or standing["progress"] or standing["state"]
        if stage != shown:
            progress(stage)
        shown = stage

    ended = client.wait_for_report(job_id, place, on_progress=follow, sleep=sleep)
    if ended["state"] == JobState.FAILED:
        problem = ended["problem"]
        kind = Invalid if problem["status"] == 422 else RehybError
        raise kind(problem["detail"], problem)
    return ended


def _fetched(client: CloseLoops, close_loop_id: str, out: Path) -> dict[str, Any]:
    """Write a report's files to `out`, all or none, and return the report."""
    from analysis.closeloop.contract import REPORT_FILES

    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".close-loop-") as scratch:
        fresh = Path(scratch)
        for name in REPORT_FILES:
            client.close_loop_file(close_loop_id, name, fresh / name)
        report: dict[str, Any] = json.loads((fresh / "report.json").read_text(encoding="utf-8"))
        out.mkdir(exist_ok=True)
        for name in REPORT_FILES:
            shutil.move(str(fresh / name), str(out / name))
    return report
