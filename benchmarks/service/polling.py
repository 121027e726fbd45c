"""How long a worker waits for a lease while fifty of them keep asking.

`python -m benchmarks.service.polling`
"""

import random
import tempfile
import threading
import time
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.measuring import percentile
from benchmarks.service.coordinator import TOKEN, coordinator, finish, lease, submit
from rehyb.client import Client

#: Together fifty workers.
PROCESSES, WORKERS_EACH = 5, 10
#: Seconds between two questions of one worker: what a coordinator without work asks for.
PAUSE_SECONDS = 1.0
SECONDS = 12.0
ROWS = 10_000


def measure(directory: Path) -> dict[str, list[float]]:
    """Return the seconds that leases took, with work for all and with none, on SQLite."""
    found = {}
    with coordinator(f"sqlite:///{directory}/polling.sqlite3") as running:
        study = submit(running.url, ROWS)
        found["with work"] = poll(running.url)
        with Client(running.url, TOKEN) as client:
            client.pause(study["id"])
        found["without work"] = poll(running.url)
    return found


def poll(url: str) -> list[float]:
    """Let fifty workers ask for some seconds; return how long each lease took, s."""
    context = get_context("spawn")
    reports: SimpleQueue[list[float]] = context.SimpleQueue()
    started = [
        context.Process(target=ask_from_threads, args=(url, number, reports))
        for number in range(PROCESSES)
    ]
    for process in started:
        process.start()
    waits = [wait for _ in started for wait in reports.get()]
    for process in started:
        process.join()
    return waits


def ask_from_threads(url: str, number: int, reports: "SimpleQueue[list[float]]") -> None:
    """Be ten workers; report how long their leases took, s."""
    waits: list[float] = []
    threads = [
        threading.Thread(target=ask, args=(url, f"poll-{number}-{i}", waits))
        for i in range(WORKERS_EACH)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    reports.put(waits)


def ask(url: str, name: str, waits: list[float]) -> None:
    """Be one worker: ask, post at once what there is, pause."""
    # Not all in the same moment.
    time.sleep(random.uniform(0.0, PAUSE_SECONDS))
    worker = {"id": name, "host": "here", "versions": {}}
    with Client(url, TOKEN) as client:
        # Opens the connection.
        client.health()
        end = time.monotonic() + SECONDS
        while time.monotonic() < end:
            started = time.perf_counter()
            granted = lease(client, worker, 1)
            waits.append(time.perf_counter() - started)
            if granted is not None:
                finish(client, worker, granted)
            time.sleep(PAUSE_SECONDS)


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        for what, waits in measure(Path(directory)).items():
            print(
                f"{PROCESSES * WORKERS_EACH} workers polling {what}: {len(waits)} leases, median "
                f"{percentile(waits, 50) * 1e3:.1f} ms, p99 {percentile(waits, 99) * 1e3:.1f} ms"
            )


if __name__ == "__main__":
    main()
