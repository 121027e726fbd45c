"""The coordinator on PostgreSQL, one and two of them, beside PgQueuer, in turns.

`python -m benchmarks.service.on_postgresql`, with the extra `rivals`; `make bench` runs it. Equal
durability: neither waits for the disk. The processor time per instance, of all processes together,
is the steadier figure on a machine that does other work.
"""

import argparse
from collections.abc import Mapping
from contextlib import ExitStack
from itertools import product

from benchmarks.machine import describe_machine
from benchmarks.measuring import Target, Throughput, middle
from benchmarks.service.coordinator import coordinator, submit, throughput
from benchmarks.service.rivals import pgqueuer_queue
from benchmarks.service.throughput import ROWS
from tests.testbed.coordinators.postgresql import serving

OPTIONS = ("synchronous_commit=off", "max_connections=200")
BATCHES = (1, 10)
#: Workers, each a process. With eight PgQueuer is slower than with four, so both stand here.
WORKERS = (8, 4)
RIVAL, ONE, TWO = "PgQueuer", "one coordinator", "two coordinators"
#: Times the rival's rate that are wanted, by system and batch.
WANTED = {(ONE, 1): 1.0, (ONE, 10): 2.0, (TWO, 10): 3.0}

#: By how many workers, system and batch.
Found = dict[tuple[int, str, int], Throughput]


def measure(seconds: float) -> Found:
    """Measure everything once."""
    found: Found = {}
    for workers, batch in product(WORKERS, BATCHES):
        with serving(OPTIONS) as server:
            found[workers, RIVAL, batch] = pgqueuer_queue.measure_batch(server, batch, workers)
        for name, count in ((ONE, 1), (TWO, 2)):
            with serving(OPTIONS) as server, ExitStack() as stack:
                url = server.database("rehyb")
                running = [stack.enter_context(coordinator(url)) for _ in range(count)]
                submit(running[0].url, ROWS)
                found[workers, name, batch] = throughput(
                    *running,
                    processes=workers,
                    batch=batch,
                    seconds=seconds,
                    database=[server.pid],
                )
    return found


def targets(rounds: list[Found]) -> list[Target]:
    """Return what was to be reached: each ratio within its own round, of several the middle."""
    return [
        Target(
            what=f"{workers} workers, {name}, batch {batch}, beside {RIVAL}",
            figure=sorted(
                one[workers, name, batch].per_second / one[workers, RIVAL, batch].per_second
                for one in rounds
            )[len(rounds) // 2],
            bound=bound,
            unit="times",
            at_least=True,
        )
        for workers, ((name, batch), bound) in product(WORKERS, WANTED.items())
    ]


def lines(rounds: list[Found]) -> list[str]:
    """Return the table: the middle of the rounds."""
    every: Mapping[tuple[int, str, int], list[Throughput]] = {
        key: [one[key] for one in rounds] for key in rounds[0]
    }
    return [
        f"  {workers} workers, {name:18} {batch:3} a lease: {middle(found).per_second:7.0f}/s, "
        f"{middle(found).cpu_ms:.3f} ms of processor time each"
        for (workers, name, batch), found in every.items()
    ]


def main() -> None:
    """Measure three rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement of ours")
    given = parser.parse_args()
    print(describe_machine())
    rounds = [measure(given.seconds) for _ in range(given.rounds)]
    print("\n".join(lines(rounds)))
    for target in targets(rounds):
        print(target.line())


if __name__ == "__main__":
    main()
