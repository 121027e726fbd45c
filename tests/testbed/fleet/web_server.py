"""A web server that is no coordinator, at a coordinator's address: of an ingress, or by mistake."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import cycle


@contextmanager
def web_server(
    port: int, statuses: Sequence[int], page: bytes = b"<html>nobody here knows rehyb</html>"
) -> Iterator[list[int]]:
    """Answer every request at a port of this machine with the next status, over and over.

    Yields the statuses that it has answered with.
    """
    to_come, answered = cycle(statuses), list[int]()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            status = next(to_come)
            answered.append(status)
            self.send_response_only(status, "so it is")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        do_GET = do_POST  # noqa: N815 - as its base class wants it.

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", port), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield answered
        finally:
            server.shutdown()
