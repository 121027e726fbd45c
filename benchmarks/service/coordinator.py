"""A coordinator in a process of its own, and processes that work for it."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Barrier
from typing import Any

from benchmarks.measuring import Throughput, cpu_seconds
from rehyb.client import Client

TOKEN = "benchmark"
#: Leases of each worker before the measurement.
WARM_UP = 3
#: Seconds that workers may take to be ready.
START_SECONDS = 60.0

Json = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Running:
    """A running coordinator."""

    url: str
    pid: int


@contextmanager
def coordinator(database_url: str) -> Iterator[Running]:
    """Run a coordinator on a database until the block ends."""
    environment = os.environ | {
        "REHYB_DATABASE_URL": database_url,
        "REHYB_TOKEN": TOKEN,
        "REHYB_PORT": "0",
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "rehyb", "coordinator"],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        match = re.search(r"http://\S+", process.stdout.readline())
        if match is None:
            sys.exit("the coordinator did not start")
        yield Running(url=match.group(), pid=process.pid)
    finally:
        process.terminate()
        process.wait(timeout=30)


def submit(url: str, rows: int) -> Json:
    """Submit a study of the Ishigami function, five instances a row; return it."""
    with Client(url, TOKEN) as client:
        return client.submit(
            {"name": "bench", "model": "ishigami", "method": "saltelli", "rows": rows}
        )


def complete(client: Client, worker: Json, batch: int) -> int:
    """Lease and post at once, as a worker whose simulations take no time; return how many."""
    granted = lease(client, worker, batch)
    return 0 if granted is None else finish(client, worker, granted)


def lease(client: Client, worker: Json, batch: int) -> Json | None:
    """Ask for instances; None if there are none."""
    return client.lease(worker=worker, models=["ishigami"], max_instances=batch)


def finish(client: Client, worker: Json, granted: Json) -> int:
    """Post a result for all that a lease holds; return how many that are."""
    verdicts = client.post_results(**done(worker, granted))
    assert all(verdict["verdict"] == "accepted" for verdict in verdicts)
    return len(verdicts)


def finish_and_lease(client: Client, worker: Json, granted: Json, batch: int) -> Json:
    """Post a result for all that a lease holds and return the next one, as a worker does."""
    request = {"worker": worker, "models": ["ishigami"], "max_instances": batch}
    answer = client.exchange(**done(worker, granted), request=request)
    assert all(verdict["verdict"] == "accepted" for verdict in answer["verdicts"])
    following: Json = answer["next"]
    return following


def done(worker: Json, granted: Json) -> Json:
    """Return what is posted about a lease, as if its simulations had taken no time."""
    results = [
        {
            "instance": instance["id"],
            "outcome": "ok",
            "outputs": {"y": 1.0},
            "reason": "",
            "state": None,
            "wall_seconds": 0.0,
        }
        for instance in granted["instances"]
    ]
    return {
        "lease": granted["id"],
        "fence": granted["fence"],
        "worker": worker["id"],
        "results": results,
    }


def throughput(
    running: Running,
    *others: Running,
    processes: int,
    batch: int,
    seconds: float,
    database: Sequence[int] = (),
) -> Throughput:
    """Measure workers that post the results of `batch` instances and lease the next ones.

    Args:
        running: a coordinator with enough to do.
        others: more of them on the same database; each has its share of the workers.
        processes: how many workers, each a process.
        batch: instances of one lease.
        seconds: how long.
        database: further processes whose time counts, such as a database server.
    """
    context = get_context("spawn")
    ready, reports = context.Barrier(processes + 1), context.SimpleQueue()
    workers = [
        context.Process(target=work, args=(one.url, f"bench-{i}", batch, seconds, ready, reports))
        for i, one in zip(range(processes), cycle((running, *others)), strict=False)
    ]
    for worker in workers:
        worker.start()
    ready.wait(START_SECONDS)
    servers = [one.pid for one in (running, *others)], database
    before = [cpu_seconds(pids) for pids in servers]
    time.sleep(seconds)
    alone, stored = (cpu_seconds(pids) - b for pids, b in zip(servers, before, strict=True))
    finished, own = zip(*(reports.get() for _ in workers), strict=True)
    for worker in workers:
        worker.join()
    return Throughput(
        per_second=sum(finished) / seconds,
        cpu_ms=(alone + stored + sum(own)) / sum(finished) * 1000.0,
        server_ms=alone / sum(finished) * 1000.0,
    )


def work(
    url: str,
    name: str,
    batch: int,
    seconds: float,
    ready: Barrier,
    reports: SimpleQueue[tuple[int, float]],
) -> None:
    """Work for a coordinator; report instances finished and the processor time it took here.

    Args:
        url: where it listens.
        name: what this worker calls itself.
        batch: instances of one lease.
        seconds: how long instances count, once all workers are ready.
        ready: where all wait for each other.
        reports: takes (instances, seconds of processor time).
    """
    worker = {"id": name, "host": "here", "versions": {}}
    with Client(url, TOKEN) as client:
        granted = lease(client, worker, batch)
        assert granted is not None
        for _ in range(WARM_UP):
            granted = finish_and_lease(client, worker, granted, batch)
        ready.wait(START_SECONDS)
        before, finished, end = time.process_time(), 0, time.monotonic() + seconds
        while time.monotonic() < end:
            finished += len(granted["instances"])
            granted = finish_and_lease(client, worker, granted, batch)
        reports.put((finished, time.process_time() - before))
