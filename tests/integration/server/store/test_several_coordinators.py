"""Several coordinators on one PostgreSQL: who does what only one may do, and what time it is."""

import time

import pytest
from sqlalchemy.engine import Engine

from server.operations.fleet import leases
from server.store import create_engine
from server.store.database.engine import alone_at, server_time


@pytest.fixture
def kind() -> str:
    return "postgresql"


def test_one_of_them_sweeps_and_the_next_one_when_it_is_gone(engine: Engine) -> None:
    other = create_engine(engine.url.render_as_string(hide_password=False))
    with alone_at(engine, "sweep") as first, alone_at(other, "sweep") as second:
        assert (first, second) == (True, False)
        with alone_at(other, "analysis") as something_else:
            assert something_else
        assert leases.reap(other, now=0.0, ttl=60.0) == 0
    with alone_at(other, "sweep") as second:
        assert second
    other.dispose()


def test_all_of_them_know_one_time(engine: Engine) -> None:
    assert server_time(engine) == pytest.approx(time.time(), abs=60.0)
