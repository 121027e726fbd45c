"""Optuna, whose workers ask a study in PostgreSQL for a trial and tell it the value."""

from importlib.metadata import version

import optuna
import sqlalchemy as sa

from benchmarks.measuring import watch
from benchmarks.service.rivals import PROCESSES, Rival, processes
from tests.testbed.coordinators.postgresql import Server

TRIALS = 300
NAME = "rival"


def measure(server: Server) -> list[Rival]:
    """Return the throughput of trials without parameters."""
    url = server.database("optuna")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    optuna.create_study(study_name=NAME, storage=url)
    done = sa.text("SELECT count(*) FROM trials WHERE state = 'COMPLETE'")
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection, processes(PROCESSES, work, url) as pids:
        found = watch(lambda: connection.scalar(done) or 0, TRIALS, pids=[server.pid, *pids])
    engine.dispose()
    name = f"Optuna {version('optuna')}, PostgreSQL"
    return [Rival(name=name, batch=1, throughput=found)]


def work(url: str) -> None:
    """Ask and tell until the process is ended."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.load_study(study_name=NAME, storage=url, sampler=optuna.samplers.RandomSampler())
    while True:
        study.tell(study.ask(), 1.0)
