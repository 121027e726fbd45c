"""A coordinator that notes what a client asks, and answers what a test wants."""

import json
from typing import Any

import httpx2

from rehyb import Client
from tests.testbed.transport import CoordinatorTransport


class Recorder:
    """Notes the last request, and answers with the next of some bodies, over and over the last."""

    def __init__(self, *answers: Any, status: int = 200, headers: dict[str, str] | None = None):
        self._answers, self._status, self._headers = list(answers) or [{}], status, headers
        self.last: httpx2.Request | None = None
        self.client = Client("http://c:1", "t", transport=CoordinatorTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        request.read()
        self.last = request
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        return httpx2.Response(self._status, json=answer, headers=self._headers)

    @property
    def told(self) -> tuple[str, str, Any]:
        """Method, path with its query, and body of the last request."""
        assert self.last is not None
        content = self.last.content
        return self.last.method, self.last.url.raw_path.decode(), json.loads(content or b"null")
