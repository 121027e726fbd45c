"""How large a fleet one coordinator carries, and two: simulated pilots on loopback.

`python -m benchmarks.service.fleet` (`make bench-fleet`). A pilot is a host of 32 cores on which an
instance takes 0.2 s; it asks and posts as `rehyb-worker` does (`pilots`). There are more and more
pilots, until the 99th percentile of what a lease takes, with results or without, is over a tenth of
a second or the pilots finish less than nine tenths of what they could. On a machine that does other
work, the processor time per instance says more: a coordinator is one process, and cannot use more
than one core.
"""

import argparse
import asyncio
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

import sqlalchemy as sa

from benchmarks.machine import describe_machine
from benchmarks.measuring import cpu_seconds, percentile
from benchmarks.service.coordinator import TOKEN, Running, coordinator, lease, submit
from benchmarks.service.pilots import Pilot
from rehyb.client import Client
from tests.testbed.coordinators.postgresql import serving
from worker.leases import WORK_SECONDS

CORES = 32
INSTANCE_SECONDS = 0.2
#: Pilots of each step, and what they must get.
STEPS = (10, 20, 40, 60, 80, 120, 160)
LONGEST_P99 = 0.1
ENOUGH = 0.9
#: Seconds of a step that count, and those before it in which everybody gets going: two leases.
SECONDS = 15.0
START_SECONDS = 2.0 * WORK_SECONDS
#: Rows of five instances: more than anybody gets through.
ROWS = 5_000_000
#: A study to extrapolate to.
LARGE = 1e8


@dataclass(frozen=True, kw_only=True)
class Step:
    """What so many pilots got."""

    pilots: int
    instances_per_second: float
    requests_per_second: float
    #: Seconds that a lease takes.
    p99: float
    #: Processor time as a share of one core, of the coordinators and of the database's server.
    coordinator: float
    database: float
    #: That of the simulated pilots themselves.
    simulation: float

    @property
    def share(self) -> float:
        """What the pilots finished of what their cores could."""
        return self.instances_per_second * INSTANCE_SECONDS / (self.pilots * CORES)

    @property
    def carried(self) -> bool:
        """Whether the pilots were served well."""
        return self.p99 <= LONGEST_P99 and self.share >= ENOUGH


async def step(running: Sequence[Running], pilots: int, database: Sequence[int]) -> Step:
    """Let so many pilots work, spread over the coordinators."""
    loop, rng = asyncio.get_running_loop(), Random(pilots)
    urls = [running[n % len(running)].url for n in range(pilots)]
    with Client(urls[0], TOKEN) as client:
        everybody = [Pilot(u, client, n, CORES, INSTANCE_SECONDS) for n, u in enumerate(urls)]
    begin = loop.time()
    counts_from, end = begin + START_SECONDS, begin + START_SECONDS + SECONDS
    work = [one.run(begin + rng.uniform(0.0, WORK_SECONDS), end) for one in everybody]
    servers = [one.pid for one in running]
    gathered = asyncio.gather(*work)
    await asyncio.sleep(counts_from - loop.time())
    before = cpu_seconds(servers), cpu_seconds(database), time.process_time()
    await asyncio.sleep(max(0.0, end - loop.time()))
    after = cpu_seconds(servers), cpu_seconds(database), time.process_time()
    took = loop.time() - counts_from
    await gathered
    used = [(b - a) / took for a, b in zip(before, after, strict=True)]
    waits = [took for one in everybody for at, took in one.asked if counts_from <= at <= end]
    posted = [size for one in everybody for at, size in one.posted if counts_from <= at <= end]
    return Step(
        pilots=pilots,
        instances_per_second=sum(posted) / SECONDS,
        requests_per_second=sum(
            counts_from <= at <= end for one in everybody for at in one.answered
        )
        / SECONDS,
        p99=percentile(waits, 99) if waits else float("inf"),
        coordinator=used[0],
        database=used[1],
        simulation=used[2],
    )


@contextmanager
def site(
    kind: str, coordinators: int, folder: Path
) -> Iterator[tuple[list[Running], list[int], str]]:
    """Yield coordinators with enough to do, processes of a database's server, and its URL."""
    with ExitStack() as stack:
        if kind == "SQLite":
            url, database = f"sqlite:///{folder}/rehyb.sqlite3", []
        else:
            server = stack.enter_context(serving(("synchronous_commit=off", "max_connections=200")))
            url, database = server.database("rehyb"), [server.pid]
        running = [stack.enter_context(coordinator(url)) for _ in range(coordinators)]
        submit(running[0].url, ROWS)
        for one in running:
            # The first lease loads what sequences of points need, which takes a second.
            with Client(one.url, TOKEN) as client:
                first = lease(client, {"id": "first", "host": "host-0", "versions": {}}, 1)
                assert first is not None
                client.release(first["id"], first["fence"])
        yield running, database, url


def stored_bytes(url: str) -> tuple[float, int]:
    """Return the bytes that a database takes on disk, and how many results are in it."""
    engine = sa.create_engine(url)
    with engine.connect() as connection:
        if engine.dialect.name == "sqlite":
            size = connection.exec_driver_sql(
                "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"
            ).scalar()
        else:
            size = connection.exec_driver_sql("SELECT pg_database_size('rehyb')").scalar()
        results = connection.exec_driver_sql("SELECT sum(result_count) FROM studies").scalar()
    engine.dispose()
    return float(size or 0), int(results or 0)


def measure(kind: str, coordinators: int, most: float) -> None:
    """Print what is carried, step by step, for so many seconds at most."""
    until = time.monotonic() + most
    carried: Step | None = None
    too_many = 0
    with (
        tempfile.TemporaryDirectory(prefix="rehyb-fleet-") as name,
        site(kind, coordinators, Path(name)) as (running, database, url),
    ):
        empty, _ = stored_bytes(url)
        for pilots in STEPS:
            found = asyncio.run(step(running, pilots, database))
            print(line(kind, coordinators, found), flush=True)
            if found.carried:
                carried, too_many = found, 0
            else:
                too_many += 1
            # One step may have been disturbed.
            if too_many == 2 or time.monotonic() > until:
                break
        size, results = stored_bytes(url)
    if results:
        each = (size - empty) / results
        text = f"  {each:.0f} bytes an instance: {LARGE * each / 1e9:.0f} GB for {LARGE:.0e}"
        if carried is not None:
            text += f", in {LARGE / carried.instances_per_second / 3600.0:.1f} hours at this rate"
        print(text, flush=True)


HEADER = (
    f"{'':10} {'coord.':>6} {'pilots':>6} {'cores':>6} {'instances/s':>11} {'wanted':>6} "
    f"{'requests/s':>10} {'lease p99':>9} {'coord. CPU':>10} {'DB CPU':>6} {'pilots':>6} "
    f"{'us each':>7}"
)


def line(kind: str, coordinators: int, found: Step) -> str:
    """Return a step as a line of the table."""
    each = (found.coordinator + found.database) / max(found.instances_per_second, 1.0) * 1e6
    return (
        f"{kind:10} {coordinators:6} {found.pilots:6} {found.pilots * CORES:6} "
        f"{found.instances_per_second:11.0f} {found.share:6.0%} {found.requests_per_second:10.0f} "
        f"{found.p99 * 1000:6.0f} ms {found.coordinator:10.2f} {found.database:6.2f} "
        f"{found.simulation:6.2f} {each:7.0f}{'' if found.carried else '  not carried'}"
    )


def main() -> None:
    """Measure SQLite with one coordinator, PostgreSQL with one, two and four."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="for each kind of site")
    seconds = parser.parse_args().seconds
    print(describe_machine())
    print(f"pilots of {CORES} cores, {INSTANCE_SECONDS} s an instance")
    print(HEADER)
    for kind, coordinators in (
        ("SQLite", 1),
        ("PostgreSQL", 1),
        ("PostgreSQL", 2),
        ("PostgreSQL", 4),
    ):
        measure(kind, coordinators, seconds)


if __name__ == "__main__":
    main()
