"""Codes that sign a browser in once. Of a code only its digest is kept."""

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.store.database.schema import sign_in_codes


def add(
    connection: Connection, digest: str, who: str, *, now: float, until: float, most: int
) -> None:
    """Store a new code; those that are too old go, and the oldest of too many of the same asker."""
    own = sign_in_codes.c.who == who
    latest = sa.select(sign_in_codes.c.digest).where(own)
    latest = latest.order_by(sign_in_codes.c.good_until.desc()).limit(most - 1)
    stale = sa.or_(
        sign_in_codes.c.good_until <= now,
        sa.and_(own, sign_in_codes.c.digest.not_in(latest.scalar_subquery())),
    )
    connection.execute(sa.delete(sign_in_codes).where(stale))
    values = {"digest": digest, "who": who, "good_until": until}
    connection.execute(sa.insert(sign_in_codes).values(values))


def take(connection: Connection, digest: str, *, now: float) -> str | None:
    """Return whose a code is, which is then used up; None if it is no good."""
    # Who removes it has it: of two who ask at once, wherever, one finds nothing to remove.
    removal = sa.delete(sign_in_codes).where(sign_in_codes.c.digest == digest)
    found = connection.execute(
        removal.returning(sign_in_codes.c.who, sign_in_codes.c.good_until)
    ).one_or_none()
    return found.who if found is not None and now < found.good_until else None
