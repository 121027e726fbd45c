"""What a client can ask a coordinator about measured sessions, and a worker about its jobs."""

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from rehyb.client.connection import Connection, Json, body_of

#: What closing the loop finds, as files.
FILES = ("report.json", "report.html", "model_after.xml", "residuals.csv")
#: Seconds that a session may take to be looked at, or a report to be stored.
LOOK_SECONDS = 300.0


class Sessions(Connection):
    """Sessions and the jobs that close the loop on them."""

    def upload_session(self, archive: Path, name: str | None = None) -> Json:
        """Upload a zipped session and return it as the coordinator understood it.

        Args:
            archive: the zip file; the same bytes again return the session already there.
            name: what to call it; default: as the file.

        Raises:
            Invalid: it cannot be analysed; the message names file, column and line.
        """
        headers = {"Content-Type": "application/zip"}
        params = {"name": name or archive.stem}
        with archive.open("rb") as file:
            return self._post(
                "/v1/sessions", seconds=LOOK_SECONDS, content=file, params=params, headers=headers
            )

    def sessions(self) -> list[Json]:
        """Return every session."""
        sessions: list[Json] = self._json("GET", "/v1/sessions")["sessions"]
        return sessions

    def session(self, session_id: str) -> Json:
        """Return one session; NotFound if there is none."""
        return self._json("GET", f"/v1/sessions/{session_id}")

    def session_archive(
        self, session_id: str, path: Path, on_chunk: Callable[[], object] = lambda: None
    ) -> None:
        """Write a session's zip file to `path`; `on_chunk` is called again and again meanwhile."""
        self._download(f"/v1/sessions/{session_id}/archive", path, on_chunk)

    def delete_session(self, session_id: str) -> None:
        """Remove a session and all that was found in it."""
        self._request("DELETE", f"/v1/sessions/{session_id}")

    def close_loop(self, session_id: str) -> Json:
        """Have a worker close the loop on a session; asking again finds the same job."""
        return self._json("POST", f"/v1/sessions/{session_id}/close-loop")

    def close_loop_report(self, close_loop_id: str) -> Json:
        """Return a job's report; before it is there ("state" is not "done"), how far the job is."""
        return self._json("GET", f"/v1/close-loops/{close_loop_id}")

    def close_loop_file(self, close_loop_id: str, file: str, path: Path) -> None:
        """Write one of FILES of a report to `path`."""
        self._download(f"/v1/close-loops/{close_loop_id}/{file}", path)

    def wait_for_report(
        self,
        close_loop_id: str,
        *,
        poll_seconds: float = 1.0,
        on_progress: Callable[[Json], None] = lambda standing: None,
    ) -> Json:
        """Block until a job is done or has failed and return what `close_loop_report` does."""
        while True:
            standing = self.close_loop_report(close_loop_id)
            if standing["state"] in ("done", "failed"):
                return standing
            on_progress(standing)
            time.sleep(poll_seconds)

    # Workers

    def lease_close_loop(self, worker: Mapping[str, Any]) -> Json | None:
        """Lease a job {"id", "lease", "fence", "ttl_seconds", "session"}.

        None (and `retry_after` set) if there is none.
        """
        response = self._request("POST", "/v1/close-loops/lease", body={"worker": worker})
        if response.status_code == HTTPStatus.NO_CONTENT:
            seconds = response.headers.get("Retry-After", "")
            self.retry_after = float(seconds) if seconds.isdigit() else 1.0
            return None
        return body_of(response)

    def renew_close_loop(self, job: Mapping[str, Any], progress: str | None) -> Json:
        """Keep a leased job and say what it is at; Conflict or NotFound if it is ours no more."""
        body = {"lease": job["lease"], "fence": job["fence"], "progress": progress}
        return self._json("POST", f"/v1/close-loops/{job['id']}/renew", body=body)

    def release_close_loop(self, job: Mapping[str, Any]) -> None:
        """Give a leased job back."""
        body = {"lease": job["lease"], "fence": job["fence"]}
        self._request("POST", f"/v1/close-loops/{job['id']}/release", body=body)

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
            job: as it was leased.
            worker: who speaks.
            outcome: "bad_session", "crashed" or "timed_out".
            reason: a sentence.
            where: {"file", "column", "line"} of what is wrong with the session.
        """
        proof = {"lease": job["lease"], "fence": job["fence"], "worker": worker}
        body = {**proof, "outcome": outcome, "reason": reason, **(where or {})}
        return self._json("POST", f"/v1/close-loops/{job['id']}/failure", body=body)

    def hand_in_report(
        self, job: Mapping[str, Any], folder: Path, *, worker: str, code: str
    ) -> Json:
        """Hand in the FILES in `folder` as a leased job's report; `code`: what made them."""
        proof = {"lease": job["lease"], "fence": job["fence"], "worker": worker, "code": code}
        path = f"/v1/close-loops/{job['id']}/report?{urlencode(proof)}"
        with ExitStack() as stack:
            files = {
                name: (name, stack.enter_context((folder / name).open("rb"))) for name in FILES
            }
            return self._post(path, seconds=LOOK_SECONDS, files=files)
