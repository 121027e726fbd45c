"""Two states of this code on PostgreSQL, by turns: what a change costs on a machine that is busy.

`python -m benchmarks.service.by_turns BEFORE AFTER`, two folders with a checkout each. Coordinators
and workers of both are there all the time, and one of them works at a time, some exchanges long:
what else the machine does changes both alike, where whole runs one after the other differ by half.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from math import exp, log
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import mean, stdev

from benchmarks.machine import describe_machine
from benchmarks.measuring import cpu_seconds
from benchmarks.service.coordinator import TOKEN, coordinator, finish_and_lease, lease, submit
from rehyb.client import Client
from tests.testbed.coordinators.postgresql import serving

PROCESSES, ROWS = 4, 200_000
#: Of each of the four workers, before anything is measured and in each block.
WARM_UP, BLOCK = 100, 50
#: What is idle keeps its leases while others have their turn.
LEASE_SECONDS = "36000"


def work(url: str, name: str, batch: int, orders: Connection) -> None:
    """Exchange as often as it is ordered, again and again, and say so."""
    worker = {"id": name, "host": "here", "versions": {}}
    with Client(url, TOKEN) as client:
        granted = lease(client, worker, batch)
        assert granted is not None
        while count := orders.recv():
            for _ in range(count):
                granted = finish_and_lease(client, worker, granted, batch)
            orders.send(count)


def serve(count: int, batch: int) -> None:
    """Run coordinators and workers of the code that is imported, for whoever writes to stdin.

    A line with a number has each worker exchange so often; the answer is the processor time in
    seconds of coordinators, PostgreSQL and workers.
    """
    os.environ["REHYB_LEASE_SECONDS"] = LEASE_SECONDS
    context = get_context("spawn")
    with serving(("synchronous_commit=off", "max_connections=200")) as server, ExitStack() as stack:
        url = server.database("rehyb")
        running = [stack.enter_context(coordinator(url)) for _ in range(count)]
        submit(running[0].url, ROWS)
        ends, workers = [], []
        for number in range(PROCESSES):
            mine, theirs = context.Pipe()
            given = running[number % count].url, f"worker-{number}", batch, theirs
            workers.append(context.Process(target=work, args=given))
            workers[-1].start()
            ends.append(mine)
        kinds = [[one.pid for one in running], [server.pid], [one.pid or 0 for one in workers]]
        for line in sys.stdin:
            before = [cpu_seconds(pids) for pids in kinds]
            for end in ends:
                end.send(int(line))
            for end in ends:
                end.recv()
            after = [cpu_seconds(pids) for pids in kinds]
            print(*(now - then for now, then in zip(after, before, strict=True)), flush=True)
        for end, worker in zip(ends, workers, strict=True):
            end.send(0)
            worker.join()


def ratio(before: Sequence[float], after: Sequence[float]) -> tuple[float, float]:
    """Return the geometric mean of `after` beside `before`, block by block, and its own error."""
    logs = [log(new / old) for old, new in zip(before, after, strict=True)]
    return exp(mean(logs)), stdev(logs) / len(logs) ** 0.5


class Side:
    """Coordinators and workers of one checkout, in processes of their own."""

    def __init__(self, tree: Path, count: int, batch: int) -> None:
        # Its own folder would be looked in first, and holds the modules of this checkout.
        command = [sys.executable, "-P", __file__, "--serve", str(count), str(batch)]
        self._process = subprocess.Popen(
            command,
            cwd=tree,
            env=os.environ | {"PYTHONPATH": str(tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def exchange(self, count: int) -> list[float]:
        """Have each worker exchange so often; return the processor time as `serve` says it."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{count}\n")
        self._process.stdin.flush()
        return [float(one) for one in self._process.stdout.readline().split()]

    def close(self) -> None:
        """Stop it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=60)


def main() -> None:
    """Measure, or serve whoever does."""
    if sys.argv[1:2] == ["--serve"]:
        serve(int(sys.argv[2]), int(sys.argv[3]))
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--coordinators", type=int, default=1)
    parser.add_argument("--batch", type=int, default=10, help="instances a lease")
    parser.add_argument("--blocks", type=int, default=24)
    given = parser.parse_args()
    sides = [
        Side(tree.resolve(), given.coordinators, given.batch)
        for tree in (given.before, given.after)
    ]
    found: list[list[list[float]]] = [[], []]
    for side in sides:
        side.exchange(WARM_UP)
    for number in range(given.blocks):
        for which in (0, 1) if number % 2 == 0 else (1, 0):
            found[which].append(sides[which].exchange(BLOCK))
    for side in sides:
        side.close()
    print(f"{describe_machine()}, load {os.getloadavg()[1]:.0f}")
    instances = BLOCK * PROCESSES * given.batch
    for name, blocks in zip(("before", "after"), found, strict=True):
        each = [mean(block[kind] for block in blocks) / instances * 1e3 for kind in range(3)]
        print(
            f"  {name:7} {sum(each):.3f} ms of processor time an instance: coordinators "
            f"{each[0]:.3f}, PostgreSQL {each[1]:.3f}, workers {each[2]:.3f}"
        )
    times, error = ratio(*([sum(block) for block in blocks] for blocks in found))
    print(f"  after beside before: {times:.3f} times, give or take {error:.3f}")


if __name__ == "__main__":
    main()
