"""Measured sessions: keeping their zip files, finding and forgetting them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.store import parts
from server.store.engine import insert, reading, writing
from server.store.schema import close_loop_parts, close_loops, session_parts, sessions


@dataclass(frozen=True, kw_only=True)
class Session:
    """A session that passed the check."""

    id: str
    name: str
    #: Of its zip file, hexadecimal.
    sha256: str
    #: Bytes of its zip file.
    size: int
    #: What was understood of it: see `analysis.closeloop.check`.
    content: Mapping[str, Any]
    #: Seconds, UTC epoch.
    created_at: float


def by_digest(engine: Engine, sha256: str) -> Session | None:
    """Return the session whose zip file has this digest; None if there is none."""
    with reading(engine) as connection:
        query = sa.select(sessions).where(sessions.c.sha256 == sha256)
        row = connection.execute(query).one_or_none()
    return None if row is None else Session(**row._mapping)


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

    Args:
        engine: where.
        file: the zip file, from its beginning.
        name: what people call it.
        sha256: digest of the file; a session with the same one is the same.
        size: bytes of the file.
        content: what was understood of it.
        now: seconds, UTC epoch.

    Returns:
        The session, and whether it is new.
    """
    session = Session(
        id=uuid4().hex[:12],
        name=name,
        sha256=sha256,
        size=size,
        content=content,
        created_at=now,
    )
    with writing(engine) as connection:
        statement = insert(connection, sessions).values(vars(session))
        statement = statement.on_conflict_do_nothing(index_elements=["sha256"])
        # Not every driver counts inserted rows, but all return them.
        if connection.scalar(statement.returning(sessions.c.id)) is not None:
            parts.write(connection, session_parts, {"session_id": session.id}, file)
            return session, True
        row = connection.execute(sa.select(sessions).where(sessions.c.sha256 == sha256)).one()
    return Session(**row._mapping), False


def get(engine: Engine, session_id: str) -> Session:
    """Return a session; NotFoundError if there is none of that id."""
    with reading(engine) as connection:
        return find(connection, session_id)


def find(connection: Connection, session_id: str, *, lock: bool = False) -> Session:
    """Return a session within a transaction; NotFoundError if there is none of that id."""
    query = sa.select(sessions).where(sessions.c.id == session_id)
    row = connection.execute(query.with_for_update() if lock else query).one_or_none()
    if row is None:
        raise NotFoundError(f"there is no session {session_id!r}")
    return Session(**row._mapping)


def every(engine: Engine) -> list[Session]:
    """Return all sessions, oldest first."""
    with reading(engine) as connection:
        query = sa.select(sessions).order_by(sessions.c.created_at, sessions.c.id)
        return [Session(**row._mapping) for row in connection.execute(query)]


def archive(engine: Engine, session: Session) -> Iterator[bytes]:
    """Yield a session's zip file, a part at a time."""
    return parts.read(engine, session_parts, {"session_id": session.id}, session.size)


def delete(engine: Engine, session_id: str) -> None:
    """Remove a session and all that was found in it; whoever works on it is not heard any more.

    Raises:
        NotFoundError: there is no session of that id.
    """
    with writing(engine) as connection:
        find(connection, session_id, lock=True)
        its_loops = sa.select(close_loops.c.id).where(close_loops.c.session_id == session_id)
        # Whoever hands in a report now has done so, or finds no job.
        connection.execute(its_loops.with_for_update())
        connection.execute(
            sa.delete(close_loop_parts).where(close_loop_parts.c.close_loop_id.in_(its_loops))
        )
        for table in (close_loops, session_parts):
            connection.execute(sa.delete(table).where(table.c.session_id == session_id))
        connection.execute(sa.delete(sessions).where(sessions.c.id == session_id))
