"""huey, with its queue and its results in a SQLite file."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

from huey import SqliteHuey

from benchmarks.measuring import watch
from benchmarks.service.rivals import PROCESSES, Rival, processes

TASKS = 3000


def measure(folder: Path) -> list[Rival]:
    """Return the throughput; `folder` takes the file."""
    file = str(folder / "huey.sqlite3")
    huey, task = queue_in(file)
    for number in range(TASKS):
        task(number)
    with processes(1, work, file) as pids:
        found = watch(huey.result_count, TASKS, pids=pids)
    name = f"huey {version('huey')}, SQLite"
    lacks = "what a killed worker had taken is lost"
    return [Rival(name=name, batch=1, throughput=found, lacks=lacks)]


def queue_in(file: str) -> tuple[SqliteHuey, Any]:
    """Return the queue in a file, and a task to put into it."""
    # Without fsync it asks less of the disk than a coordinator does.
    huey = SqliteHuey(filename=file, fsync=False)
    return huey, huey.task(name="noop")(noop)


def noop(number: int) -> float:
    return 1.0


def work(file: str) -> None:
    """Run a consumer with its worker processes."""
    huey, _ = queue_in(file)
    huey.create_consumer(
        workers=PROCESSES, worker_type="process", periodic=False, initial_delay=0.01
    ).run()
