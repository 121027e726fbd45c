"""A proxy that loses, delays, repeats and reorders: a laboratory's network on a bad day."""

import http.client
import random
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import MappingProxyType

FAULTS = ("dropped", "answer lost", "delayed", "repeated", "reordered")


class BadNetwork:
    """Forwards HTTP to any of `ports` of this machine from a port of its own, badly.

    A request may be dropped before it arrives, its answer may be lost after it took effect, it may
    be late or arrive twice; or it arrives only after those that were sent later, when its sender
    has long tried again.
    """

    def __init__(
        self,
        ports: Sequence[int],
        seed: int,
        trouble: float = 0.08,
        slow: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self.faults: Counter[str] = Counter()
        #: Seconds by which requests of these paths arrive late, always.
        self._slow = slow
        self._targets = ports
        self._rng = random.Random(seed)
        self._trouble = trouble
        network = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                network.forward(self)

            def do_POST(self) -> None:
                network.forward(self)

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def forward(self, handler: BaseHTTPRequestHandler) -> None:
        """Serve one request of a worker."""
        body = handler.rfile.read(int(handler.headers.get("Content-Length", 0)))
        fault = "none"
        if self._rng.random() < self._trouble:
            fault = self._rng.choice(FAULTS)
            self.faults[fault] += 1
        handler.close_connection = True
        time.sleep(self._slow.get(handler.path, 0.0))
        if fault == "dropped":
            return
        if fault == "reordered":
            self._deliver_later(handler, dict(handler.headers.items()), body)
            return
        if fault == "delayed":
            time.sleep(self._rng.uniform(0.1, 1.0))
        try:
            headers = dict(handler.headers.items())
            answer = self._ask(handler, headers, body)
            if fault == "repeated":
                answer = self._ask(handler, headers, body)
            if fault != "answer lost":
                self._pass_on(handler, *answer)
        except OSError:
            # The coordinator is away, or the worker is: either finds a closed connection.
            return

    def _deliver_later(
        self, handler: BaseHTTPRequestHandler, headers: dict[str, str], body: bytes
    ) -> None:
        def deliver() -> None:
            with suppress(OSError):
                self._ask(handler, headers, body)

        timer = threading.Timer(self._rng.uniform(0.5, 4.0), deliver)
        timer.daemon = True
        timer.start()

    def _ask(
        self, handler: BaseHTTPRequestHandler, headers: dict[str, str], body: bytes
    ) -> tuple[int, list[tuple[str, str]], bytes]:
        target = self._rng.choice(self._targets)
        connection = http.client.HTTPConnection("127.0.0.1", target, timeout=20)
        try:
            headers = {k: v for k, v in headers.items() if k.lower() != "host"}
            connection.request(handler.command, handler.path, body, headers)
            response = connection.getresponse()
            return response.status, response.getheaders(), response.read()
        except http.client.HTTPException as error:
            raise ConnectionError(str(error)) from error
        finally:
            connection.close()

    @staticmethod
    def _pass_on(
        handler: BaseHTTPRequestHandler, status: int, headers: list[tuple[str, str]], body: bytes
    ) -> None:
        handler.send_response(status)
        for name, value in headers:
            if name.lower() not in ("transfer-encoding", "connection", "content-length"):
                handler.send_header(name, value)
        if status != 204:
            handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        handler.wfile.write(body)
