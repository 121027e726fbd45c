"""How long a signed-in worker waits for a lease while strangers hold connections half open.

`python -m benchmarks.service.flood`
"""

import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from benchmarks.machine import describe_machine
from benchmarks.measuring import percentile, say
from benchmarks.service.coordinator import TOKEN, coordinator, finish, lease, submit
from rehyb.client import Client

HALF_OPEN = 1000
LEASES = 500


def main() -> None:
    """Print the 99th percentile of a lease, with and without a flood."""
    say(describe_machine())
    with (
        tempfile.TemporaryDirectory() as folder,
        coordinator(f"sqlite:///{folder}/flood.sqlite3") as running,
    ):
        submit(running.url, 10_000)
        calm = waits(running.url)
        with half_open(running.url) as flood:
            flooded = waits(running.url)
            say(f"{len(flood)} half-open connections from this address")
    for name, found in (("without", calm), ("with", flooded)):
        p50, p99 = (1e3 * percentile(found, percent) for percent in (50.0, 99.0))
        say(f"lease {name} them: median {p50:.1f} ms, p99 {p99:.1f} ms of {len(found)}")


@contextmanager
def half_open(url: str) -> Iterator[list[socket.socket]]:
    """Open connections that begin a request and never end it."""
    where = urlsplit(url)
    flood: list[socket.socket] = []
    for _ in range(HALF_OPEN):
        flood.append(socket.create_connection((where.hostname, where.port)))
        flood[-1].send(b"POST /v1/leases HTTP/1.1\r\nHost:")
    yield flood
    for one in flood:
        one.close()


def waits(url: str) -> list[float]:
    """Return how long leases of one worker take that connects anew for each ten of them, s."""
    worker = {"id": "bench", "host": "here", "versions": {}}
    found: list[float] = []
    while len(found) < LEASES:
        with Client(url, TOKEN) as client:
            for _ in range(10):
                started = time.perf_counter()
                granted = lease(client, worker, 1)
                found.append(time.perf_counter() - started)
                assert granted is not None
                finish(client, worker, granted)
    return found


if __name__ == "__main__":
    main()
