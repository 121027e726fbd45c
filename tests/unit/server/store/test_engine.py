"""Which databases a coordinator can have."""

import pytest

from server.errors import CoordinatorError
from server.store import create_engine


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("oracle://lab/rehyb", "oracle"),
        ("postgres://lab/rehyb", "postgres"),
        ("postgresql://lab/rehyb", "postgresql"),
        ("postgresql+psycopg://lab:port/rehyb", "postgresql+psycopg"),
        ("rehyb.sqlite3", "rehyb.sqlite3"),
        ("", ""),
    ],
)
def test_what_is_no_database_of_ours_is_one_sentence(url: str, kind: str) -> None:
    with pytest.raises(CoordinatorError, match="sqlite:///FILE or postgresql") as refused:
        create_engine(url)
    assert f"begins with {kind!r}" in str(refused.value)


@pytest.mark.parametrize(
    "url",
    ["sqlite://", "sqlite:///", "sqlite:///:memory:", "sqlite://lab/x", "sqlite:///:memory:?x=1"],
)
def test_a_url_of_sqlite_that_names_no_file_is_told_how_one_is_written(url: str) -> None:
    with pytest.raises(CoordinatorError, match=r"names no file: sqlite:///FILE has three slashes"):
        create_engine(url)


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("sqlite:///x?mode=ro", "sqlite:///FILE takes no options: leave out ?mode"),
        (
            "postgresql+psycopg://lab/x?nope=1",
            'the database\'s URL: invalid connection option "nope"',
        ),
        (
            "postgresql+psycopg://lab/x?connect_timeout=soon",
            "the database's URL: connect_timeout is a whole number, not 'soon'",
        ),
        (
            "postgresql+psycopg://lab:99999/x",
            "the database's URL: a port is 1 to 65535, not '99999'",
        ),
    ],
)
def test_an_option_that_no_database_takes_is_refused_before_anybody_waits(
    url: str, says: str
) -> None:
    with pytest.raises(CoordinatorError) as refused:
        create_engine(url)
    assert str(refused.value) == says


@pytest.mark.parametrize(
    "url",
    [
        "postgresql+psycopg://me:secret@lab:5433/x?connect_timeout=3&sslmode=require",
        "postgresql+psycopg:///x?host=/run/postgresql&connect_timeout=-1",
        "postgresql+psycopg:///x?host=one:5433&host=two:5434&target_session_attrs=read-write",
    ],
)
def test_what_libpq_takes_is_taken(url: str) -> None:
    create_engine(url).dispose()


def test_a_password_is_not_told() -> None:
    with pytest.raises(CoordinatorError) as refused:
        create_engine("mysql://me:secret@lab/rehyb")
    assert "secret" not in str(refused.value)
