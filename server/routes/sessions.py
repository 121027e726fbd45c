"""Measured sessions: upload a zip file, see what was understood of it, have it back."""

import asyncio
import hashlib
import re
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import StringConstraints
from sqlalchemy.engine import Engine

from server.http.texts import FILE_NAME, HIDDEN
from server.operations import sessions
from server.records import Session
from server.routes.common import Configured, Id, Now, Route, Store, attachment
from server.routes.uploads import ZIP_OR_FORM, receive
from server.sandbox import check

router = APIRouter(prefix="/v1/sessions", tags=["sessions"], route_class=Route)

#: What a session may be called: it names a file.
SessionName = Annotated[str, StringConstraints(min_length=1, max_length=60, pattern=FILE_NAME)]


@router.post(
    "",
    status_code=201,
    openapi_extra={"requestBody": {"required": True, "content": ZIP_OR_FORM}},
)
async def upload(
    request: Request,
    response: Response,
    store: Store,
    settings: Configured,
    now: Now,
    name: Annotated[SessionName | None, Query(examples=["monday"])] = None,
) -> dict[str, Any]:
    """Upload a session as a zip file: the body, or the one file of a form.

    The same bytes again return the session already there (200). One that cannot be analysed is
    refused (422) with file, column and line, and nothing of it is kept.
    """
    with TemporaryDirectory(prefix="rehyb-upload-") as scratch:
        received = Path(scratch) / "received"
        filename = await receive(request, received, settings.session_bytes)
        called = name or _stem(filename) or "session"
        sha256 = await asyncio.to_thread(_digest, received)
        known = await asyncio.to_thread(sessions.by_digest, store, sha256)
        if known is None:
            # Errors call a file by its name.
            file = received.rename(received.with_name(f"{called}.zip"))
            async with request.app.state.looks:
                content = await check("analysis.closeloop.check", file)
            session, new = await asyncio.to_thread(
                _keep, store, file, name=called, sha256=sha256, content=content, now=now
            )
        else:
            session, new = known, False
    response.headers["Location"] = f"/v1/sessions/{session.id}"
    response.status_code = 201 if new else 200
    return shown(session)


@router.get("")
def every(store: Store) -> dict[str, Any]:
    """List all sessions, oldest first."""
    return {"sessions": [shown(session) for session in sessions.every(store)]}


@router.get("/{session_id}")
def show(session_id: Id, store: Store) -> dict[str, Any]:
    """Show a session as it was understood."""
    return shown(sessions.get(store, session_id))


@router.get("/{session_id}/archive")
def archive(session_id: Id, store: Store) -> StreamingResponse:
    """Return the zip file that was uploaded."""
    session = sessions.get(store, session_id)
    return attachment(sessions.archive(store, session), session.size, f"{session.id}.zip")


@router.delete("/{session_id}", status_code=204)
def delete(session_id: Id, store: Store) -> None:
    """Remove a session and everything that was found in it."""
    sessions.delete(store, session_id)


def shown(session: Session) -> dict[str, Any]:
    """Return a session as readers see it."""
    return {
        "id": session.id,
        "name": session.name,
        "sha256": session.sha256,
        "size": session.size,
        "created_at": session.created_at,
        **session.content,
    }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _keep(store: Engine, path: Path, **known: Any) -> tuple[Session, bool]:
    with path.open("rb") as file:
        return sessions.create(store, file, size=path.stat().st_size, **known)


def _stem(filename: str | None) -> str | None:
    """Return what a session is called that came as a file of this name; None if it says nothing."""
    stem = PurePath((filename or "").replace("\\", "/")).stem
    return re.sub(f"[{HIDDEN}]", "_", stem)[:60] or None
