"""The coordinator beside what a user would take instead, and beside its targets, in one run.

`python -m benchmarks.side_by_side`, with the extra `rivals`. All do the same: four worker processes
take tasks, do nothing, and hand in a result, which is stored and outlives the worker. No system
waits for the disk: a power cut may take the last second with it.
"""

import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks import million, polling, service
from benchmarks.machine import describe_machine
from benchmarks.postgresql import serving
from benchmarks.rivals import (
    Rival,
    celery_queue,
    huey_queue,
    optuna_storage,
    pgqueuer_queue,
    procrastinate_queue,
)
from benchmarks.table import HEADER, Line, ours, targets, theirs

#: Like SQLite's write-ahead log and Redis's file: commits do not wait for the disk.
POSTGRESQL = ("synchronous_commit=off", "max_connections=100")


def main() -> None:
    print(describe_machine())
    print(f"\nTasks that do nothing, {service.PROCESSES} worker processes, results stored")
    print(HEADER)
    with tempfile.TemporaryDirectory(prefix="rehyb-bench-") as name, serving(POSTGRESQL) as server:
        folder = Path(name)
        on_sqlite = service.measure(f"sqlite:///{folder}/rehyb.sqlite3")
        _print(ours("rehyb, SQLite", on_sqlite))
        rivals: list[Rival] = []
        for file_rival in (celery_queue, huey_queue):
            rivals += _shown(file_rival.measure(folder))
        on_postgresql = service.measure(server.database("rehyb"), [server.pid])
        _print(ours("rehyb, PostgreSQL", on_postgresql))
        for rival in (pgqueuer_queue, procrastinate_queue, optuna_storage):
            rivals += _shown(rival.measure(server))
        waits = polling.measure(folder)
        study = million.measure(folder)
    print("\nTargets")
    for target in targets(on_sqlite, rivals, waits, study):
        print(target.line())


def _shown(found: list[Rival]) -> list[Rival]:
    _print(theirs(found))
    return found


def _print(lines: Iterable[Line]) -> None:
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
