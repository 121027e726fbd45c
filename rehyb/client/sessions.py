"""What a client can ask a coordinator about measured sessions."""

from collections.abc import Callable
from pathlib import Path

from rehyb.client.connection import Connection, Json, as_path, for_reading, path_of


class Sessions(Connection):
    """Measured sessions."""

    def upload_session(self, archive: Path | str, name: str | None = None) -> Json:
        """Upload a zipped session and return it as the coordinator understood it.

        Args:
            archive: the zip file; the same bytes again return the session already there.
            name: what to call it; default: as the file.

        Raises:
            Invalid: it cannot be analysed; the message names file, column and line.
        """
        headers = {"Content-Type": "application/zip"}
        path = as_path(archive)
        params = {"name": name or path.stem}
        with for_reading(path) as file:
            return self._post("/v1/sessions", content=file, params=params, headers=headers)

    def sessions(self) -> list[Json]:
        """Return every session."""
        sessions: list[Json] = self._json("GET", "/v1/sessions")["sessions"]
        return sessions

    def session(self, session_id: str) -> Json:
        """Return one session; NotFound if there is none."""
        return self._json("GET", path_of("sessions", session_id))

    def session_archive(
        self, session_id: str, path: Path | str, on_chunk: Callable[[], object] = lambda: None
    ) -> None:
        """Write a session's zip file to `path`; `on_chunk` is called again and again meanwhile."""
        self._download(path_of("sessions", session_id, "archive"), path, on_chunk)

    def delete_session(self, session_id: str) -> None:
        """Remove a session and all that was found in it."""
        self._request("DELETE", path_of("sessions", session_id))
