"""What an engine promises of its connections."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.store.database.engine import reading


def test_a_connection_that_is_in_use_while_its_pool_is_given_up_is_closed_when_it_comes_back(
    engine: Engine,
) -> None:
    closed: list[Any] = []
    sa.event.listen(engine, "close", lambda driver, _: closed.append(driver))
    with reading(engine) as connection:
        driver = connection.connection.dbapi_connection
        engine.dispose()
        assert connection.scalar(sa.text("SELECT 1")) == 1
        assert driver not in closed
    assert driver in closed


def test_a_connection_that_comes_back_in_time_is_used_again(engine: Engine) -> None:
    used = []
    for _ in range(2):
        with reading(engine) as connection:
            used.append(connection.connection.dbapi_connection)
    assert used[0] is used[1]
