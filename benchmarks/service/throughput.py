"""How fast a coordinator hands out instances and takes their results back, in real processes.

`python -m benchmarks.service.throughput` measures it on SQLite; `make bench` beside what else there
is.
"""

import tempfile
from collections.abc import Sequence

from benchmarks.machine import describe_machine
from benchmarks.measuring import Throughput
from benchmarks.service.coordinator import coordinator, submit, throughput

#: Instances per lease.
BATCHES = (1, 10, 100)
#: Workers, each a process, as many for all that is compared.
PROCESSES = 4
SECONDS = 4.0
#: Rows of five instances: more than any machine finishes in that time.
ROWS = 200_000


def measure(database_url: str, database: Sequence[int] = ()) -> dict[int, Throughput]:
    """Return the throughput by batch on a fresh database.

    Args:
        database_url: where.
        database: processes of a database server, whose time counts too.
    """
    found = {}
    with coordinator(database_url) as running:
        submit(running.url, ROWS)
        for batch in BATCHES:
            found[batch] = throughput(
                running, processes=PROCESSES, batch=batch, seconds=SECONDS, database=database
            )
    return found


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        for batch, found in measure(f"sqlite:///{directory}/rehyb.sqlite3").items():
            print(
                f"{PROCESSES} workers, {batch:3d} instances a lease: {found.per_second:7.0f}/s, "
                f"{found.cpu_ms:.2f} ms of processor time per instance"
            )


if __name__ == "__main__":
    main()
