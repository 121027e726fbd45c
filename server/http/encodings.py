"""JSON comes in UTF-8 (RFC 8259, 8.1): what comes otherwise is told so, at every route alike."""

import json
from http import HTTPStatus

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: Methods of requests that have a body.
_WITH_BODY = ("POST", "PUT", "PATCH")


def is_json(kind: str) -> bool:
    """Say whether a Content-Type is JSON's, as FastAPI does of its routes."""
    family, _, member = kind.partition(";")[0].strip().lower().partition("/")
    return family == "application" and (member == "json" or member.endswith("+json"))


class Utf8:
    """Turn away JSON in UTF-16 or UTF-32, which some routes would read and others not."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] == "http" and scope["method"] in _WITH_BODY:
            given = next((v for name, v in scope["headers"] if name == b"content-type"), b"")
            if is_json(given.decode("latin-1")):
                receive = _looking(receive)
        await self._app(scope, receive, send)


def _looking(receive: Receive) -> Receive:
    """Return a `receive` that looks at the first bytes that `receive` brings."""
    seen = False

    async def looking() -> Message:
        nonlocal seen
        message = await receive()
        body = message.get("body", b"")
        if body and not seen:
            seen = True
            encoding = json.detect_encoding(body[:4])
            if not encoding.startswith("utf-8"):
                name = encoding[:6].upper()
                raise HTTPException(
                    HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"the body is in {name}: send JSON in UTF-8"
                )
        return message

    return looking
