"""Tokens: making, revoking and recognising them."""

from collections.abc import Sequence
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.errors import ConflictError, NotFoundError
from server.logic.tokens import SCOPES, Token, digest, new_secret
from server.store.engine import reading, writing
from server.store.schema import tokens


def create(engine: Engine, *, name: str, scopes: Sequence[str], now: float) -> tuple[Token, str]:
    """Make a token; returns it and its secret, which can never be had again.

    Raises:
        ConflictError: a scope is unknown, or there is none.
    """
    if unknown := [scope for scope in scopes if scope not in SCOPES]:
        raise ConflictError(f"there is no scope {unknown[0]!r}: take {', '.join(SCOPES)}")
    if not scopes:
        raise ConflictError(f"a token needs a scope: {', '.join(SCOPES)}")
    secret = new_secret()
    token = Token(
        id=uuid4().hex[:8],
        name=name,
        scopes=tuple(dict.fromkeys(scopes)),
        created_at=now,
        revoked_at=None,
    )
    values = {
        "id": token.id,
        "name": token.name,
        "scopes": list(token.scopes),
        "digest": digest(secret.encode()),
        "created_at": now,
    }
    with writing(engine) as connection:
        connection.execute(sa.insert(tokens).values(values))
    return token, secret


def every(engine: Engine) -> list[Token]:
    """Return all tokens ever made, oldest first."""
    with reading(engine) as connection:
        found = connection.execute(sa.select(tokens).order_by(tokens.c.created_at, tokens.c.id))
        return [_token(row) for row in found]


def revoke(engine: Engine, token_id: str, *, now: float) -> Token:
    """Make a token worthless, for good; NotFoundError if there is none of that id."""
    with writing(engine) as connection:
        connection.execute(
            sa.update(tokens)
            .where(tokens.c.id == token_id, tokens.c.revoked_at.is_(None))
            .values(revoked_at=now)
        )
        row = connection.execute(sa.select(tokens).where(tokens.c.id == token_id)).one_or_none()
    if row is None:
        raise NotFoundError(f"there is no token {token_id!r}: see `rehyb token list`")
    return _token(row)


def scopes_of(engine: Engine, secret: bytes) -> tuple[str, ...]:
    """Return the scopes of whoever knows `secret`; none if it is no good."""
    query = sa.select(tokens.c.scopes).where(
        tokens.c.digest == digest(secret), tokens.c.revoked_at.is_(None)
    )
    with reading(engine) as connection:
        found: Any = connection.scalar(query)
    return tuple(found or ())


def _token(row: Any) -> Token:
    return Token(
        id=row.id,
        name=row.name,
        scopes=tuple(row.scopes),
        created_at=row.created_at,
        revoked_at=row.revoked_at,
    )
