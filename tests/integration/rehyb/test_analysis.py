"""`rehyb analysis` outlives its database's server, and ends where waiting would not help."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from sqlalchemy.engine import Engine

from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.store import create_engine, upgrade
from server.store.database.engine import writing
from tests.testbed.coordinators import exchanges
from tests.testbed.coordinators.postgresql import Server, serving
from tests.testbed.coordinators.records import plan
from tests.testbed.coordinators.service import PATIENCE_SECONDS, running


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """A PostgreSQL server that may be killed."""
    with serving(("autovacuum=off",)) as server:
        yield server


def test_an_analysis_outlives_its_server_at_its_start_and_while_it_is_idle(server: Server) -> None:
    url = server.database("outlived")
    upgrade(url)
    engine = create_engine(url)
    with ExitStack() as stack:
        with server.away():
            analysis = stack.enter_context(running("analysis", url))
            assert "is away, and waited for: its server does not answer" in analysis.said()
        assert "the database is back" in analysis.said()
        wait_for_indices(engine, worked_off(engine))
        assert analysis.is_silent()
        with server.away():
            assert "is away, and waited for: " in analysis.said()
        assert "the database is back" in analysis.said()
        wait_for_indices(engine, worked_off(engine))
        assert analysis.stop() == 0
        assert analysis.is_silent()
    engine.dispose()


def test_an_analysis_that_is_stopped_while_it_waits_ends_without_an_error(server: Server) -> None:
    with server.away(), running("analysis", server.url) as analysis:
        assert "waited for" in analysis.said()
        assert analysis.stop() == 0
        assert analysis.is_silent()


@pytest.mark.parametrize("kind", ["postgresql", "sqlite"])
def test_an_analysis_waits_until_a_coordinator_has_made_the_database(
    server: Server, tmp_path: Path, kind: str
) -> None:
    file = tmp_path / "rehyb.sqlite3"
    url = server.database("bare") if kind == "postgresql" else f"sqlite:///{file}"
    why = "the database has schema none" if kind == "postgresql" else f"there is no database {file}"
    with running("analysis", url) as analysis:
        said = analysis.said()
        assert f"a coordinator's start is waited for: {why}" in said
        # Long enough for a second look, which says nothing and makes no file.
        time.sleep(2.5)
        assert analysis.is_silent() and not file.exists()
        upgrade(url)
        engine = create_engine(url)
        assert "the database is there" in analysis.said()
        wait_for_indices(engine, worked_off(engine))
        engine.dispose()
        assert analysis.stop() == 0
        assert analysis.is_silent()


def test_an_analysis_of_a_newer_version_waits_until_its_coordinator_is_started(
    server: Server,
) -> None:
    url = server.database("older")
    upgrade(url)
    engine = create_engine(url)
    head = marked(engine, "0001")
    with running("analysis", url) as analysis:
        assert "is waited for: the database has schema 0001, this rehyb works" in analysis.said()
        marked(engine, head)
        assert "the database is there" in analysis.said()
        assert analysis.stop() == 0
    engine.dispose()


def test_a_database_of_a_newer_version_ends_an_analysis(server: Server) -> None:
    url = server.database("newer")
    upgrade(url)
    engine = create_engine(url)
    marked(engine, "9999")
    engine.dispose()
    with running("analysis", url) as analysis:
        assert analysis.ended() == 1
        assert "made by a newer version; upgrade rehyb" in analysis.said()
        assert analysis.is_silent()


def test_what_waiting_does_not_mend_ends_an_analysis_at_its_start(server: Server) -> None:
    for url, words in (
        (server.url.replace("/postgres", "/elsewhere"), 'database "elsewhere" does not exist'),
        (server.url.replace("rehyb@", "nobody@"), 'role "nobody" does not exist'),
    ):
        with running("analysis", url) as analysis:
            assert analysis.ended() == 1
            said = analysis.said()
            assert said.startswith("rehyb: ") and words in said
            assert analysis.is_silent()


def marked(engine: Engine, schema: str) -> str:
    """Have a database pass for one of another schema; return which it had."""
    with writing(engine) as connection:
        before = connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalar()
        connection.exec_driver_sql(f"UPDATE alembic_version SET version_num = '{schema}'")
    return str(before)


def worked_off(engine: Engine) -> str:
    """Make a study and the results of its two rows; return its name."""
    study, _ = studies.create(engine, plan(), key=None, digest="", now=0.0)
    _, held = exchanges.serve(
        engine, exchanges.Exchange(request=exchanges.asking("w", 8), now=0.0, ttl=1e6)
    )
    assert isinstance(held, exchanges.Grant) and held.study.id == study.id
    everything = [(n, {"outputs": {"y": float(n)}}) for n in range(len(held.lease.instances))]
    posted = exchanges.posting(held, everything)
    exchanges.serve(engine, exchanges.Exchange(posted=posted, now=1.0, ttl=1e6))
    return study.id


def wait_for_indices(engine: Engine, study: str) -> None:
    """Wait until the indices of a study are of both its rows."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while (StoreResultLog(engine).snapshot(study) or {"rows_complete": 0})["rows_complete"] < 2:
        assert time.monotonic() < deadline, "no analysis took in what was there"
        time.sleep(0.1)
