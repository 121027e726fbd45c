"""procrastinate, with its jobs in PostgreSQL, where they stay when they are done."""

from importlib.metadata import version

import sqlalchemy as sa
from procrastinate import App, PsycopgConnector, SyncPsycopgConnector
from procrastinate.types import JSONDict

from benchmarks.measuring import watch
from benchmarks.service.rivals import PROCESSES, Rival, processes
from tests.testbed.coordinators.postgresql import Server

TASKS = 2000
#: Jobs that one process works on at once: while one waits for the database, others go on.
CONCURRENCY = 5
#: It keeps how a job ended, but not what it found: each job writes that itself.
RESULTS = "CREATE TABLE results (number bigint PRIMARY KEY, y double precision)"


def measure(server: Server) -> list[Rival]:
    """Return the throughput."""
    url = server.database("procrastinate").replace("+psycopg", "")
    app = App(connector=SyncPsycopgConnector(conninfo=url))
    with app.open():
        app.schema_manager.apply_schema()
        app.connector.execute_query(RESULTS)
        numbers: list[JSONDict] = [{"number": number} for number in range(TASKS)]
        app.configure_task("noop").batch_defer(*numbers)
    done = sa.text("SELECT count(*) FROM procrastinate_jobs WHERE status = 'succeeded'")
    engine = sa.create_engine(url.replace("://", "+psycopg://"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection, processes(PROCESSES, work, url) as pids:
        found = watch(lambda: connection.scalar(done) or 0, TASKS, pids=[server.pid, *pids])
    engine.dispose()
    name = f"procrastinate {version('procrastinate')}, PostgreSQL"
    return [Rival(name=name, batch=1, throughput=found)]


def work(url: str) -> None:
    """Run a worker."""
    app = App(connector=PsycopgConnector(conninfo=url))

    @app.task(name="noop")
    async def noop(number: int) -> None:
        await app.connector.execute_query_async(
            "INSERT INTO results VALUES (%(number)s, %(y)s)", number=number, y=1.0
        )

    app.run_worker(concurrency=CONCURRENCY)
