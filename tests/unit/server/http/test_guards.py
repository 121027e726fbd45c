"""What is answered before a body has come."""

import asyncio
from typing import Any

import pytest

from server.http.guards import MAX_BODY_BYTES, BodyLimit


@pytest.mark.parametrize("sends", [0, 3], ids=["nothing", "all of it"])
def test_who_announces_too_much_hears_so_at_once_and_may_go_on_sending(sends: int) -> None:
    parts = [
        {"type": "http.request", "body": b"x", "more_body": n + 1 < sends} for n in range(sends)
    ]
    events: list[Any] = []

    async def receive() -> Any:
        events.append("asked")
        return parts.pop(0) if parts else {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        events.append(message)

    async def app(*_: Any) -> None:
        raise AssertionError("it is served")

    length = (b"content-length", str(MAX_BODY_BYTES + 1).encode())
    scope = {"type": "http", "method": "POST", "path": "/v1/studies", "headers": [length]}
    asyncio.run(BodyLimit(app, large=1)(scope, receive, send))
    start, body, *drained, end = events
    assert start["status"] == 413 and b"8388608 bytes at most" in body["body"]
    # Its end is what makes a server take the next request, which must not be a part of this body.
    assert body["more_body"] and not end.get("more_body")
    assert drained == ["asked"] * max(sends, 1)
