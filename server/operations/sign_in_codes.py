"""Codes that sign in once, as in the address that `rehyb page` prints.

They are in the database, since whichever coordinator a balancer asks must know them.
"""

import secrets

from sqlalchemy.engine import Engine

from server.logic.signing_in import CODE_SECONDS, MOST_CODES
from server.logic.tokens import digest
from server.store import sign_in_codes
from server.store.database.engine import writing


def new(engine: Engine, who: str, *, now: float) -> str:
    """Return a new code for `who`, a token's id or `OPERATOR`."""
    code = secrets.token_urlsafe(16)
    until = now + CODE_SECONDS
    with writing(engine) as connection:
        sign_in_codes.add(
            connection, digest(code.encode()), who, now=now, until=until, most=MOST_CODES
        )
    return code


def take(engine: Engine, code: str, *, now: float) -> str | None:
    """Return whose a code is, which is then used up; None if it is no good."""
    with writing(engine) as connection:
        return sign_in_codes.take(connection, digest(code.encode()), now=now)
