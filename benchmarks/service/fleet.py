"""How large a fleet one coordinator carries, and two: simulated pilots on loopback.

`python -m benchmarks.service.fleet` (`make bench-fleet`). A pilot is a host of 32 cores on which an
instance takes 0.2 s. It leases two seconds of work, 320 instances, and two seconds later posts
their results with its request for the next. There are more and more pilots, until the 99th
percentile of such an exchange is over a tenth of a second or the pilots get less than they could
compute. On a machine that does other work, the processor time per instance says more: a coordinator
is one process, and cannot use more than one core.
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
from statistics import quantiles
from urllib.parse import urlsplit

import sqlalchemy as sa
from pydantic_core import from_json, to_json

from benchmarks.machine import describe_machine
from benchmarks.measuring import cpu_seconds
from benchmarks.service.coordinator import TOKEN, Json, Running, coordinator, done, submit
from tests.testbed.coordinators.postgresql import serving

CORES = 32
INSTANCE_SECONDS = 0.2
LEASE_SECONDS = 2.0
BATCH = int(CORES * LEASE_SECONDS / INSTANCE_SECONDS)
#: Pilots of each step, and what they must get.
STEPS = (5, 10, 20, 40, 80, 160, 320)
LONGEST_P99 = 0.1
ENOUGH = 0.9
#: Seconds of a step that count, after one lease in which everybody has got going.
SECONDS = 6.0
#: Rows of five instances: more than anybody gets through.
ROWS = 5_000_000
#: A study to extrapolate to.
LARGE = 1e8


@dataclass(frozen=True, kw_only=True)
class Step:
    """What so many pilots got."""

    pilots: int
    instances_per_second: float
    #: Seconds.
    p99: float
    #: Processor time as a share of one core, of the coordinators and of the database's server.
    coordinator: float
    database: float
    #: That of the simulated pilots themselves.
    simulation: float

    @property
    def carried(self) -> bool:
        """Whether the pilots were served well."""
        wanted = self.pilots * CORES / INSTANCE_SECONDS
        return self.p99 <= LONGEST_P99 and self.instances_per_second >= ENOUGH * wanted


class Pilot:
    """One host: a connection of its own, without what a client of Python costs."""

    def __init__(self, url: str, number: int) -> None:
        self._where = urlsplit(url)
        self._worker: Json = {"id": f"pilot-{number}", "host": f"host-{number % 2}", "versions": {}}
        self.waits: list[tuple[float, float, int]] = []

    async def run(self, begin: float, end: float) -> None:
        """Work from one moment of the loop's clock to another."""
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, begin - loop.time()))
        reader, writer = await asyncio.open_connection(self._where.hostname, self._where.port)
        request = {"worker": self._worker, "models": ["ishigami"], "max_instances": BATCH}
        lease = await self._ask(reader, writer, "/v1/leases", request)
        due = loop.time()
        while lease is not None and due < end:
            due += LEASE_SECONDS
            await asyncio.sleep(max(0.0, due - loop.time()))
            started = loop.time()
            body = {**done(self._worker, lease), "next": request}
            answer = await self._ask(reader, writer, "/v1/results", body)
            assert answer is not None
            count = len(lease["instances"])
            self.waits.append((started, loop.time() - started, count))
            # Who was kept waiting computes no faster afterwards.
            due = max(due, loop.time() - 0.1)
            lease = answer["next"]
        writer.close()

    async def _ask(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str, body: Json
    ) -> Json | None:
        content = to_json(body)
        head = (
            f"POST {path} HTTP/1.1\r\nHost: c\r\nAuthorization: Bearer {TOKEN}\r\n"
            f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n\r\n"
        )
        writer.write(head.encode() + content)
        status = int((await reader.readline()).split()[1])
        length = 0
        while (line := await reader.readline()) != b"\r\n":
            name, _, value = line.partition(b":")
            if name.lower() == b"content-length":
                length = int(value)
        found = from_json(await reader.readexactly(length)) if length else None
        if status >= 400:
            raise RuntimeError(f"{path} answered {status}: {found}")
        return found


async def step(running: Sequence[Running], pilots: int, database: Sequence[int]) -> Step:
    """Let so many pilots work, spread over the coordinators."""
    loop, rng = asyncio.get_running_loop(), Random(pilots)
    everybody = [Pilot(running[n % len(running)].url, n) for n in range(pilots)]
    begin = loop.time()
    counts_from, end = begin + 2 * LEASE_SECONDS, begin + 2 * LEASE_SECONDS + SECONDS
    work = [one.run(begin + rng.uniform(0.0, LEASE_SECONDS), end) for one in everybody]
    servers = [one.pid for one in running]
    gathered = asyncio.gather(*work)
    await asyncio.sleep(counts_from - loop.time())
    before = cpu_seconds(servers), cpu_seconds(database), time.process_time()
    await asyncio.sleep(max(0.0, end - loop.time()))
    after = cpu_seconds(servers), cpu_seconds(database), time.process_time()
    took = loop.time() - counts_from
    await gathered
    counted = [w for one in everybody for w in one.waits if counts_from <= w[0] + w[1] <= end]
    used = [(b - a) / took for a, b in zip(before, after, strict=True)]
    waits = sorted(seconds for _, seconds, _ in counted)
    return Step(
        pilots=pilots,
        instances_per_second=sum(count for _, _, count in counted) / SECONDS,
        p99=quantiles(waits, n=100, method="inclusive")[-1] if len(waits) > 1 else float("inf"),
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
    with (
        tempfile.TemporaryDirectory(prefix="rehyb-fleet-") as name,
        site(kind, coordinators, Path(name)) as (running, database, url),
    ):
        empty, _ = stored_bytes(url)
        for pilots in STEPS:
            found = asyncio.run(step(running, pilots, database))
            print(line(kind, coordinators, found), flush=True)
            if found.carried:
                carried = found
            elif carried is not None:
                break
            if time.monotonic() > until:
                break
        size, results = stored_bytes(url)
    if results:
        each = (size - empty) / results
        text = f"  {each:.0f} bytes an instance: {LARGE * each / 1e9:.0f} GB for {LARGE:.0e}"
        if carried is not None:
            text += f", in {LARGE / carried.instances_per_second / 3600.0:.1f} hours at this rate"
        print(text, flush=True)


HEADER = (
    f"{'':12} {'coordinators':>12} {'pilots':>7} {'cores':>6} {'instances/s':>12} {'p99':>8} "
    f"{'coord. CPU':>10} {'DB CPU':>7} {'pilots CPU':>10} {'CPU us each':>12}"
)


def line(kind: str, coordinators: int, found: Step) -> str:
    """Return a step as a line of the table."""
    each = (found.coordinator + found.database) / max(found.instances_per_second, 1.0) * 1e6
    return (
        f"{kind:12} {coordinators:12} {found.pilots:7} {found.pilots * CORES:6} "
        f"{found.instances_per_second:12.0f} {found.p99 * 1000:5.0f} ms {found.coordinator:10.2f} "
        f"{found.database:7.2f} {found.simulation:10.2f} {each:12.0f}"
        f"{'' if found.carried else '  not carried'}"
    )


def main() -> None:
    """Measure SQLite with one coordinator, PostgreSQL with one, two and four."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=90.0, help="for each line of the table")
    seconds = parser.parse_args().seconds
    print(describe_machine())
    print(f"pilots of {CORES} cores, {INSTANCE_SECONDS} s an instance, {BATCH} instances a lease")
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
