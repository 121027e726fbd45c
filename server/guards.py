"""What stands before every route: who may speak, and how much they may say at once."""

import hmac
from http import HTTPStatus

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import problem

#: Largest request body taken.
MAX_BODY_BYTES = 8 * 1024 * 1024


class BearerToken:
    """Turn away requests to /v1 that do not bear the token, before anything of them is read."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app = app
        self._expected = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http" or not _guarded(scope["path"]) or self._is_borne_by(scope):
            await self._app(scope, receive, send)
            return
        refusal = problem(
            HTTPStatus.UNAUTHORIZED,
            "send the header `Authorization: Bearer TOKEN` with the coordinator's token",
            headers={"WWW-Authenticate": "Bearer"},
        )
        await refusal(scope, receive, send)

    def _is_borne_by(self, scope: Scope) -> bool:
        scheme, _, token = Headers(scope=scope).get("authorization", "").partition(" ")
        # Headers are decoded as Latin-1: encoding them so gives the bytes that were sent.
        borne = token.strip().encode("latin-1")
        return hmac.compare_digest(borne, self._expected) and scheme.lower() == "bearer"


class BodyLimit:
    """Turn away requests with more than `MAX_BODY_BYTES`, announced or not."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        announced = Headers(scope=scope).get("content-length", "0")
        if announced.isdecimal() and int(announced) > MAX_BODY_BYTES:
            await problem(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, _TOO_LARGE)(scope, receive, send)
            return
        received = 0

        async def counting() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > MAX_BODY_BYTES:
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, _TOO_LARGE)
            return message

        await self._app(scope, counting, send)


_TOO_LARGE = f"a request may have {MAX_BODY_BYTES} bytes at most: post results in smaller batches"


def _guarded(path: str) -> bool:
    return path in ("/v1", "/metrics") or path.startswith("/v1/")
