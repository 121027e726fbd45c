"""A proxy that loses, delays and repeats: what a laboratory's network does on a bad day."""

import http.client
import random
import threading
import time
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class BadNetwork:
    """Forwards HTTP to `port` of this machine from a port of its own, badly.

    A request may be dropped before it arrives, its answer may be lost after it took effect, it may
    be late (and so overtaken by others), or arrive twice.
    """

    def __init__(self, port: int, seed: int, trouble: float = 0.08) -> None:
        self.faults: Counter[str] = Counter()
        self._target = port
        self._rng = random.Random(seed)
        self._trouble = trouble
        network = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

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
            fault = self._rng.choice(["dropped", "answer lost", "delayed", "repeated"])
            self.faults[fault] += 1
        handler.close_connection = True
        if fault == "dropped":
            return
        if fault == "delayed":
            time.sleep(self._rng.uniform(0.1, 1.0))
        try:
            answer = self._ask(handler, body)
            if fault == "repeated":
                answer = self._ask(handler, body)
            if fault != "answer lost":
                self._pass_on(handler, *answer)
        except OSError:
            # The coordinator is away, or the worker is: either finds a closed connection.
            return

    def _ask(
        self, handler: BaseHTTPRequestHandler, body: bytes
    ) -> tuple[int, list[tuple[str, str]], bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self._target, timeout=20)
        try:
            headers = {k: v for k, v in handler.headers.items() if k.lower() != "host"}
            connection.request("POST", handler.path, body, headers)
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
