"""Tokens. Of a secret only its digest is kept."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.errors import NotFoundError
from server.records import Token
from server.store.database.schema import tokens


def add(connection: Connection, token: Token, *, digest: str) -> None:
    """Store a new token, recognised by its secret's digest."""
    values = {**vars(token), "scopes": list(token.scopes), "digest": digest}
    connection.execute(sa.insert(tokens).values(values))


def every(connection: Connection) -> list[Token]:
    """Return all tokens ever made, oldest first."""
    found = connection.execute(sa.select(tokens).order_by(tokens.c.created_at, tokens.c.id))
    return [_token(row) for row in found]


def revoke(connection: Connection, token_id: str, *, now: float) -> Token:
    """Make a token worthless, for good; NotFoundError if there is none of that id."""
    connection.execute(
        sa.update(tokens)
        .where(tokens.c.id == token_id, tokens.c.revoked_at.is_(None))
        .values(revoked_at=now)
    )
    row = connection.execute(sa.select(tokens).where(tokens.c.id == token_id)).one_or_none()
    if row is None:
        raise NotFoundError(f"there is no token {token_id!r}: see `rehyb token list`")
    return _token(row)


def good(connection: Connection, *, digest: str | None = None, token_id: str = "") -> Token | None:
    """Return a token that is not revoked, by its secret's digest or by its id; None if none is."""
    which = tokens.c.id == token_id if digest is None else tokens.c.digest == digest
    row = connection.execute(
        sa.select(tokens).where(which, tokens.c.revoked_at.is_(None))
    ).one_or_none()
    return None if row is None else _token(row)


def _token(row: Any) -> Token:
    values = {name: value for name, value in row._mapping.items() if name != "digest"}
    return Token(**{**values, "scopes": tuple(row.scopes)})
