"""How fast a coordinator takes studies in and results back, with real processes on SQLite.

`python -m benchmarks.service`
"""

import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from benchmarks.machine import describe_machine
from rehyb.client import Client

TOKEN = "benchmark"
#: Clients and instances per lease of each measurement.
CASES = ((1, 10), (8, 10), (8, 50))
SECONDS = 5.0


def start_coordinator(directory: Path) -> tuple[subprocess.Popen[str], str]:
    """Return a running coordinator on a fresh database, and its URL."""
    environment = os.environ | {
        "REHYB_DATABASE_URL": f"sqlite:///{directory}/rehyb.sqlite3",
        "REHYB_TOKEN": TOKEN,
        "REHYB_PORT": "0",
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "rehyb", "coordinator"],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    match = re.search(r"http://\S+", process.stdout.readline())
    if match is None:
        sys.exit("the coordinator did not start")
    return process, match.group()


def work(url: str, batch: int, stop: threading.Event, counts: list[int]) -> None:
    """Lease and post at once, as a worker whose simulations take no time."""
    done = 0
    name = f"bench-{threading.get_ident()}"
    worker = {"id": name, "host": "here", "versions": {}}
    with Client(url, TOKEN) as client:
        while not stop.is_set():
            lease = client.lease(worker=worker, models=["ishigami"], max_instances=batch)
            if lease is None:
                break
            results = [
                {
                    "instance": instance["id"],
                    "outcome": "ok",
                    "outputs": {"y": 1.0},
                    "reason": "",
                    "state": None,
                    "wall_seconds": 0.0,
                }
                for instance in lease["instances"]
            ]
            client.post_results(
                lease=lease["id"], fence=lease["fence"], worker=name, results=results
            )
            done += len(results)
    counts.append(done)


def measure(url: str, clients: int, batch: int) -> float:
    """Return results per second, leasing and posting together."""
    stop, counts = threading.Event(), list[int]()
    threads = [
        threading.Thread(target=work, args=(url, batch, stop, counts)) for _ in range(clients)
    ]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    time.sleep(SECONDS)
    stop.set()
    for thread in threads:
        thread.join()
    return sum(counts) / (time.perf_counter() - started)


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        process, url = start_coordinator(Path(directory))
        try:
            study = {"name": "bench", "model": "ishigami", "method": "saltelli", "rows": 200_000}
            with Client(url, TOKEN) as client:
                started = time.perf_counter()
                accepted = client.submit(study)
                seconds = time.perf_counter() - started
            print(f"a study of {accepted['instances']} instances was accepted in {seconds:.2f} s")
            for clients, batch in CASES:
                rate = measure(url, clients, batch)
                print(f"{clients} clients, {batch:3d} instances a lease: {rate:6.0f} results/s")
        finally:
            process.terminate()
            process.wait(timeout=30)


if __name__ == "__main__":
    main()
