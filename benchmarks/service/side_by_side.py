"""The coordinator beside what a user would take instead, and beside its targets, in one run.

`python -m benchmarks.service.side_by_side`, with the extra `rivals`. All do the same: four worker
processes take tasks, do nothing, and hand in a result, which is stored and outlives the worker. No
system waits for the disk: a power cut may take the last second with it.
"""

import tempfile
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.measuring import say
from benchmarks.service import million, polling, throughput
from benchmarks.service.rivals import (
    Rival,
    celery_queue,
    huey_queue,
    optuna_storage,
    pgqueuer_queue,
    procrastinate_queue,
)
from benchmarks.service.table import HEADER, Round, beside, lines, targets
from tests.testbed.coordinators.postgresql import serving

#: Like SQLite's write-ahead log and Redis's file: commits do not wait for the disk.
POSTGRESQL = ("synchronous_commit=off", "max_connections=100")
#: Each system is measured so often, in turns.
ROUNDS = 3


def main() -> None:
    print(describe_machine())
    rounds = [measured(f"round {number} of {ROUNDS}") for number in range(1, ROUNDS + 1)]
    with tempfile.TemporaryDirectory(prefix="rehyb-bench-") as name:
        say("waiting, and a study of a million instances")
        waits = polling.measure(Path(name))
        study = million.measure(Path(name))
    print(f"\nTasks that do nothing, {throughput.PROCESSES} worker processes, results stored;")
    print(f"the middle of {ROUNDS} rounds, and the least and the most")
    print(HEADER)
    for line in lines(rounds):
        print(line)
    print("\nTargets")
    for target in targets(rounds, waits, study):
        print(target.line())
    for which, found in beside(rounds).items():
        print(f"  beside the best durable rival, {which}: {', '.join(f'{x:.2f}' for x in found)}")


def measured(what: str) -> Round:
    """Measure every system once, each with a new database."""
    rivals: list[Rival] = []
    with tempfile.TemporaryDirectory(prefix="rehyb-bench-") as name, serving(POSTGRESQL) as server:
        folder = Path(name)
        say(f"{what}: rehyb on SQLite")
        on_sqlite = throughput.measure(f"sqlite:///{folder}/rehyb.sqlite3")
        for on_postgresql_rival in (pgqueuer_queue, procrastinate_queue, optuna_storage):
            say(f"{what}: {on_postgresql_rival.__name__}")
            rivals += on_postgresql_rival.measure(server)
        for file_rival in (celery_queue, huey_queue):
            say(f"{what}: {file_rival.__name__}")
            rivals += file_rival.measure(folder)
        say(f"{what}: rehyb on PostgreSQL")
        on_postgresql = throughput.measure(server.database("rehyb"), [server.pid])
    return Round(on_sqlite=on_sqlite, on_postgresql=on_postgresql, rivals=rivals)


if __name__ == "__main__":
    main()
