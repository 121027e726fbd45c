"""What stands before every route: who may speak, and how much they may say at once."""

import asyncio
import hmac
import re
from collections.abc import Callable
from http import HTTPStatus
from time import monotonic

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.logic.tokens import FAILURE_SECONDS, Failures, may, scopes_needed
from server.problems import problem

#: Largest request body taken.
MAX_BODY_BYTES = 8 * 1024 * 1024
#: What a form adds to the file in it.
ENVELOPE_BYTES = 10_000
#: Seconds a token is believed after it was looked up: a revoked one is good for as long at most.
BELIEVED_SECONDS = 5.0

#: Returns the scopes of whoever knows a secret; none if it is no good.
LookUp = Callable[[bytes], tuple[str, ...]]


class BearerToken:
    """Turn away who may not, before anything of the request is read.

    Args:
        app: what is guarded: /v1, /metrics and /openapi.json.
        token: the operator's own, which may do everything.
        look_up: finds the scopes of all others in the database.
    """

    def __init__(self, app: ASGIApp, token: str, look_up: LookUp) -> None:
        self._app = app
        self._expected = token.encode()
        self._look_up = look_up
        self._failures = Failures()
        self._believed: dict[bytes, tuple[float, tuple[str, ...]]] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http" or not _guarded(scope["path"]):
            await self._app(scope, receive, send)
            return
        refusal = await self._objection(scope)
        await (refusal or self._app)(scope, receive, send)

    async def _objection(self, scope: Scope) -> ASGIApp | None:
        """Return the answer to a request that is turned away; None if it may pass."""
        borne = _borne_by(scope)
        if borne is not None and hmac.compare_digest(borne, self._expected):
            _let_in(scope)
            return None
        address = (scope.get("client") or ("",))[0]
        now = monotonic()
        scopes = await self._scopes_of(borne, address, now) if borne else ()
        if scopes is None:
            return problem(
                HTTPStatus.TOO_MANY_REQUESTS,
                "too many wrong tokens came from this address: correct the token and wait",
                headers={"Retry-After": str(int(FAILURE_SECONDS))},
            )
        if not scopes:
            self._failures.count(address, now)
            return problem(
                HTTPStatus.UNAUTHORIZED,
                "send the header `Authorization: Bearer TOKEN` with the coordinator's token",
                headers={"WWW-Authenticate": "Bearer"},
            )
        needed = scopes_needed(scope["method"], scope["path"])
        _let_in(scope)
        if may(scopes, needed):
            return None
        has, needs = ", ".join(scopes), " or ".join(needed)
        return problem(
            HTTPStatus.FORBIDDEN, f"this needs a token with the scope {needs}; yours has {has}"
        )

    async def _scopes_of(self, borne: bytes, address: str, now: float) -> tuple[str, ...] | None:
        """Return the scopes of a secret; None if its address has failed too often to ask."""
        until, scopes = self._believed.get(borne, (0.0, ()))
        if now < until:
            return scopes
        # A token that was good before must not suffer from what others send from its address.
        if borne not in self._believed and self._failures.too_many(address, now):
            return None
        scopes = await asyncio.to_thread(self._look_up, borne)
        # Only good ones are remembered: wrong ones come without number.
        if scopes:
            self._believed[borne] = (now + BELIEVED_SECONDS, scopes)
        else:
            self._believed.pop(borne, None)
        return scopes


class BodyLimit:
    """Turn away requests with more than `MAX_BODY_BYTES`, announced or not.

    `large`: bytes that a request may have which brings a session, or what was found in one.
    """

    def __init__(self, app: ASGIApp, large: int) -> None:
        self._app = app
        self._large = large

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit, refusal = MAX_BODY_BYTES, _TOO_LARGE
        if scope["method"] == "POST" and _LARGE.fullmatch(scope["path"]):
            limit = self._large + ENVELOPE_BYTES
            refusal = upload_too_large(self._large)
        announced = Headers(scope=scope).get("content-length", "0")
        if announced.isdecimal() and int(announced) > limit:
            await problem(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, refusal)(scope, receive, send)
            return
        received = 0

        async def counting() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, refusal)
            return message

        await self._app(scope, counting, send)


#: Requests that bring files.
_LARGE = re.compile(r"/v1/sessions|/v1/models|/v1/close-loops/[^/]+/report")
_TOO_LARGE = f"a request may have {MAX_BODY_BYTES} bytes at most: post results in smaller batches"


def upload_too_large(limit: int) -> str:
    """Say that a session, what was found in one, or a model has more than `limit` bytes."""
    return f"an upload may have {limit} bytes at most (REHYB_SESSION_BYTES)"


def _let_in(scope: Scope) -> None:
    """Tell the connection, if there is one, that whoever is at its other end is no stranger."""
    connection = scope.get("rehyb.connection")
    if connection is not None:
        connection.signed_in()


def _guarded(path: str) -> bool:
    return path in ("/v1", "/metrics", "/openapi.json") or path.startswith("/v1/")


def _borne_by(scope: Scope) -> bytes | None:
    """Return the token a request bears; None if it bears none."""
    scheme, _, token = Headers(scope=scope).get("authorization", "").partition(" ")
    # Headers are decoded as Latin-1: encoding them so gives the bytes that were sent.
    return token.strip().encode("latin-1") if scheme.lower() == "bearer" else None
