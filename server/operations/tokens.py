"""Tokens: making, revoking and recognising them."""

from collections.abc import Sequence
from uuid import uuid4

from sqlalchemy.engine import Engine

from server.errors import BadSettingError
from server.logic.tokens import NAME_LENGTH, SCOPES, digest, is_name, new_secret
from server.records import Token
from server.store import tokens
from server.store.database.engine import alone_reading, reading, writing

every = alone_reading(tokens.every)


def create(engine: Engine, *, name: str, scopes: Sequence[str], now: float) -> tuple[Token, str]:
    """Make a token; returns it and its secret, which can never be had again.

    Raises:
        BadSettingError: a scope is unknown, or there is none; or the name is none.
    """
    if not is_name(name):
        raise BadSettingError(
            f"a token's name is a line of 1 to {NAME_LENGTH} characters, not {name[:NAME_LENGTH]!r}"
        )
    if unknown := [scope for scope in scopes if scope not in SCOPES]:
        raise BadSettingError(f"there is no scope {unknown[0]!r}: take {', '.join(SCOPES)}")
    if not scopes:
        raise BadSettingError(f"a token needs a scope: {', '.join(SCOPES)}")
    secret = new_secret()
    token = Token(
        id=uuid4().hex[:8],
        name=name,
        scopes=tuple(dict.fromkeys(scopes)),
        created_at=now,
        revoked_at=None,
    )
    with writing(engine) as connection:
        tokens.add(connection, token, digest=digest(secret.encode()))
    return token, secret


def revoke(engine: Engine, token_id: str, *, now: float) -> Token:
    """Make a token worthless, for good."""
    with writing(engine) as connection:
        return tokens.revoke(connection, token_id, now=now)


def good(engine: Engine, secret_or_id: bytes | str) -> Token | None:
    """Return the token with this secret (bytes) or id (str), if it is good."""
    with reading(engine) as connection:
        if isinstance(secret_or_id, str):
            return tokens.good(connection, token_id=secret_or_id)
        return tokens.good(connection, digest=digest(secret_or_id))
