"""Measured sessions and their zip files."""

from collections.abc import Iterator
from typing import BinaryIO

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.records import Session
from server.store.database import parts
from server.store.database.engine import insert
from server.store.database.schema import session_parts, sessions


def add(connection: Connection, session: Session, file: BinaryIO) -> bool:
    """Store a new session with its zip file; False if there is one with the same digest."""
    statement = insert(connection, sessions).values(vars(session))
    statement = statement.on_conflict_do_nothing(index_elements=["sha256"])
    # Not every driver counts inserted rows, but all return them.
    if connection.scalar(statement.returning(sessions.c.id)) is None:
        return False
    parts.write(connection, session_parts, {"session_id": session.id}, file)
    return True


def by_digest(connection: Connection, sha256: str) -> Session | None:
    """Return the session whose zip file has this digest; None if there is none."""
    row = connection.execute(sa.select(sessions).where(sessions.c.sha256 == sha256)).one_or_none()
    return None if row is None else Session(**row._mapping)


def find(connection: Connection, session_id: str, *, lock: bool = False) -> Session:
    """Return a session; NotFoundError if there is none of that id."""
    query = sa.select(sessions).where(sessions.c.id == session_id)
    row = connection.execute(query.with_for_update() if lock else query).one_or_none()
    if row is None:
        raise NotFoundError(f"there is no session {session_id!r}")
    return Session(**row._mapping)


def every(connection: Connection) -> list[Session]:
    """Return all sessions, oldest first."""
    query = sa.select(sessions).order_by(sessions.c.created_at, sessions.c.id)
    return [Session(**row._mapping) for row in connection.execute(query)]


def archive(engine: Engine, session: Session) -> Iterator[bytes]:
    """Yield a session's zip file, a part at a time, each in a transaction of its own."""
    return parts.read(engine, session_parts, {"session_id": session.id}, session.size)


def delete(connection: Connection, session_id: str) -> None:
    """Remove a session and its zip file."""
    connection.execute(sa.delete(session_parts).where(session_parts.c.session_id == session_id))
    connection.execute(sa.delete(sessions).where(sessions.c.id == session_id))
