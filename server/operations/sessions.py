"""Measured sessions: keeping their zip files, finding and forgetting them."""

from collections.abc import Mapping
from typing import Any, BinaryIO
from uuid import uuid4

from sqlalchemy.engine import Engine

from server.records import Session
from server.store import close_loops, sessions
from server.store.database.engine import alone_reading, writing

by_digest = alone_reading(sessions.by_digest)
get = alone_reading(sessions.find)
every = alone_reading(sessions.every)
archive = sessions.archive


def create(
    engine: Engine,
    file: BinaryIO,
    *,
    name: str,
    sha256: str,
    size: int,
    content: Mapping[str, Any],
    now: float,
) -> tuple[Session, bool]:
    """Store a session that passed the check.

    `content`: what was understood of it. A session whose zip file has the same digest is the same.

    Returns:
        The session, and whether it is new.
    """
    session = Session(
        id=uuid4().hex[:12], name=name, sha256=sha256, size=size, content=content, created_at=now
    )
    with writing(engine) as connection:
        if sessions.add(connection, session, file):
            return session, True
        first = sessions.by_digest(connection, sha256)
    # It was there a moment ago, in the same transaction.
    assert first is not None
    return first, False


def delete(engine: Engine, session_id: str) -> None:
    """Remove a session and all that was found in it; whoever works on it is not heard any more."""
    with writing(engine) as connection:
        sessions.find(connection, session_id, lock=True)
        close_loops.delete_of_session(connection, session_id)
        sessions.delete(connection, session_id)
