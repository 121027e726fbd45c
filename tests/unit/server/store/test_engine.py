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
    ["sqlite://", "sqlite:///", "sqlite:///:memory:", "sqlite://lab/x", "sqlite:///x?mode=memory"],
)
def test_a_url_of_sqlite_that_names_no_file_is_told_how_one_is_written(url: str) -> None:
    with pytest.raises(CoordinatorError, match=r"names no file: sqlite:///FILE has three slashes"):
        create_engine(url)


def test_a_password_is_not_told() -> None:
    with pytest.raises(CoordinatorError) as refused:
        create_engine("mysql://me:secret@lab/rehyb")
    assert "secret" not in str(refused.value)
