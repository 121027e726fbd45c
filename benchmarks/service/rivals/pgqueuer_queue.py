"""PgQueuer, with its jobs in PostgreSQL and a log of how each ended."""

import asyncio
from importlib.metadata import version

import asyncpg
import sqlalchemy as sa
from pgqueuer import PgQueuer
from pgqueuer.db import AsyncpgDriver
from pgqueuer.models import Job
from pgqueuer.queries import Queries

from benchmarks.measuring import Throughput, watch
from benchmarks.service.rivals import PROCESSES, Rival, processes
from tests.testbed.coordinators.postgresql import Server

#: By batch: as many as take some seconds.
TASKS = {1: 1500, 10: 6000, 100: 6000}
#: It keeps how a job ended, but not what it found: each job writes that itself.
RESULTS = "CREATE TABLE results (number bigint PRIMARY KEY, y double precision)"
#: Connections over which the jobs of one worker write.
CONNECTIONS = 4


def measure(server: Server) -> list[Rival]:
    """Return the throughput by batch."""
    name = f"PgQueuer {version('pgqueuer')}, PostgreSQL"
    return [
        Rival(name=name, batch=batch, throughput=measure_batch(server, batch, PROCESSES))
        for batch in TASKS
    ]


def measure_batch(server: Server, batch: int, workers: int) -> Throughput:
    """Return the throughput of so many workers, each a process, that take `batch` jobs at once."""
    url = server.database(f"pgqueuer_{batch}")
    plain = url.replace("+psycopg", "")
    asyncio.run(submit(plain, TASKS[batch]))
    done = sa.text("SELECT count(*) FROM pgqueuer_log WHERE status = 'successful'")
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection, processes(workers, work, plain, batch) as pids:
        found = watch(lambda: connection.scalar(done) or 0, TASKS[batch], pids=[server.pid, *pids])
    engine.dispose()
    return found


async def submit(url: str, tasks: int) -> None:
    """Make the tables and put the jobs into them."""
    connection = await asyncpg.connect(url)
    queries = Queries(AsyncpgDriver(connection))
    await queries.install()
    await connection.execute(RESULTS)
    payloads: list[bytes | None] = [b"%d" % number for number in range(tasks)]
    await queries.enqueue(["noop"] * tasks, payloads, [0] * tasks)
    await connection.close()


def work(url: str, batch: int) -> None:
    """Run a worker that takes `batch` jobs at once."""

    async def serve() -> None:
        connection = await asyncpg.connect(url)
        results = await asyncpg.create_pool(url, min_size=CONNECTIONS, max_size=CONNECTIONS)
        queuer = PgQueuer(AsyncpgDriver(connection))

        @queuer.entrypoint("noop")
        async def noop(job: Job) -> None:
            await results.execute("INSERT INTO results VALUES ($1, $2)", int(job.payload or 0), 1.0)

        await queuer.run(batch_size=batch)

    asyncio.run(serve())
