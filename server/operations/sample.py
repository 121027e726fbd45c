"""The first runs of a study's rows."""

from collections.abc import Mapping

from sqlalchemy.engine import Engine

from server.store import results
from server.store.database.engine import reading


def first_of_rows(
    engine: Engine, study_id: str, *, rows: int
) -> dict[int, tuple[str, Mapping[str, float] | None]]:
    """Return outcome and outputs at position 0 of the first rows, by row, where there are any."""
    with reading(engine) as connection:
        return results.first_of_rows(connection, study_id, rows=rows)
