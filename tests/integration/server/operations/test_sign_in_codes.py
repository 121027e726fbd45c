"""Codes sign in once, within the hour, wherever on one database they are shown."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.logic.signing_in import CODE_SECONDS, MOST_CODES
from server.operations import sign_in_codes
from server.store import create_engine
from server.store.database.engine import reading


def test_a_code_signs_in_once_and_within_the_hour(engine: Engine) -> None:
    code = sign_in_codes.new(engine, "anna", now=0.0)
    assert len(code) == 22, "of 128 random bits"
    assert sign_in_codes.take(engine, code, now=CODE_SECONDS - 1.0) == "anna"
    assert sign_in_codes.take(engine, code, now=CODE_SECONDS - 1.0) is None
    late = sign_in_codes.new(engine, "anna", now=0.0)
    assert sign_in_codes.take(engine, late, now=CODE_SECONDS) is None
    assert sign_in_codes.take(engine, "", now=0.0) is None


def test_codes_that_nobody_uses_do_not_pile_up(engine: Engine) -> None:
    def kept() -> int:
        with reading(engine) as connection:
            return connection.scalar(sa.text("SELECT count(*) FROM sign_in_codes")) or 0

    first, *others = [
        sign_in_codes.new(engine, "anna", now=float(n)) for n in range(MOST_CODES + 1)
    ]
    assert kept() == MOST_CODES
    assert sign_in_codes.take(engine, first, now=200.0) is None
    assert sign_in_codes.take(engine, others[0], now=200.0) == "anna"
    sign_in_codes.new(engine, "anna", now=CODE_SECONDS + MOST_CODES)
    assert kept() == 1, "those that are too old are gone"


def test_nobody_pushes_out_the_codes_of_others(engine: Engine) -> None:
    mine = sign_in_codes.new(engine, "anna", now=0.0)
    for number in range(MOST_CODES):
        sign_in_codes.new(engine, "ben", now=1.0 + number)
    assert sign_in_codes.take(engine, mine, now=200.0) == "anna"


def test_a_database_that_leaks_leaks_no_code(engine: Engine) -> None:
    code = sign_in_codes.new(engine, "anna", now=0.0)
    with reading(engine) as connection:
        (row,) = connection.execute(sa.text("SELECT * FROM sign_in_codes")).all()
    assert code not in map(str, row)


@pytest.mark.parametrize("kind", ["postgresql"])
def test_of_coordinators_that_are_shown_a_code_at_once_one_takes_it(
    engine: Engine, kind: str
) -> None:
    other = create_engine(engine.url.render_as_string(hide_password=False))
    for _ in range(5):
        code = sign_in_codes.new(engine, "anna", now=0.0)
        together = threading.Barrier(2)

        def show(to: Engine, code: str = code, together: Any = together) -> str | None:
            together.wait(10.0)
            return sign_in_codes.take(to, code, now=1.0)

        with ThreadPoolExecutor(2) as threads:
            assert {*threads.map(show, (engine, other))} == {"anna", None}
    other.dispose()
