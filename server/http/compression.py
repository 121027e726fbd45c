"""Request bodies may come compressed with gzip; what they unpack to is limited all the same."""

import zlib
from http import HTTPStatus

from fastapi import HTTPException
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.http.problems import problem

#: Tells zlib to expect gzip's header and checksum.
_GZIP = 16 + zlib.MAX_WBITS


class Gunzip:
    """Unpack bodies with `Content-Encoding: gzip` up to `limit` bytes; refuse other encodings."""

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        encoding = "identity"
        if scope["type"] == "http":
            encoding = Headers(scope=scope).get("content-encoding", "identity").strip().lower()
        if encoding == "identity":
            await self._app(scope, receive, send)
            return
        if encoding != "gzip":
            refusal = problem(
                HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"send bodies plain or as gzip, not {encoding!r}"
            )
            await refusal(scope, receive, send)
            return
        scope = {**scope, "headers": list(scope["headers"])}
        headers = MutableHeaders(scope=scope)
        # Both speak of what came over the wire, not of what the routes will read.
        del headers["content-encoding"]
        del headers["content-length"]
        await self._app(scope, _unpacking(receive, self._limit), send)


def _unpacking(receive: Receive, limit: int) -> Receive:
    """Return a `receive` that unpacks what `receive` brings."""
    stream = zlib.decompressobj(_GZIP)
    unpacked = 0

    async def unpacking() -> Message:
        nonlocal unpacked
        message = await receive()
        if message["type"] != "http.request":
            return message
        try:
            body = stream.decompress(message.get("body", b""), limit - unpacked + 1)
        except zlib.error as error:
            raise HTTPException(HTTPStatus.BAD_REQUEST, f"the body is not gzip: {error}") from None
        unpacked += len(body)
        if unpacked > limit:
            raise HTTPException(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                f"a request may unpack to {limit} bytes at most",
            )
        if stream.unused_data or (not message.get("more_body", False) and not stream.eof):
            raise HTTPException(HTTPStatus.BAD_REQUEST, "the body is not one whole gzip file")
        return {**message, "body": body}

    return unpacking
