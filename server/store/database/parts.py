"""Files in the database, cut up: neither a writer nor a reader holds a whole one in memory."""

from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.store.database.engine import reading

#: Bytes of a part.
PART_BYTES = 1 << 20


def write(
    connection: Connection, table: sa.Table, owner: Mapping[str, str], file: BinaryIO
) -> None:
    """Store what is left to read of `file` under the key columns `owner` of `table`."""
    for number, content in enumerate(iter(lambda: file.read(PART_BYTES), b"")):
        values = {**owner, "number": number, "content": content}
        connection.execute(sa.insert(table), values)


def size(connection: Connection, table: sa.Table, owner: Mapping[str, str]) -> int:
    """Return how many bytes are stored under `owner`."""
    query = sa.select(sa.func.sum(sa.func.length(table.c.content))).where(*_of(table, owner))
    return int(connection.scalar(query) or 0)


def read(engine: Engine, table: sa.Table, owner: Mapping[str, str], size: int) -> Iterator[bytes]:
    """Yield the `size` bytes stored under `owner`; between two parts nothing is kept open.

    Raises:
        NotFoundError: it was deleted meanwhile.
    """
    number = 0
    while size > 0:
        query = sa.select(table.c.content).where(*_of(table, owner), table.c.number == number)
        with reading(engine) as connection:
            content: bytes | None = connection.scalar(query)
        if not content:
            raise NotFoundError("it was deleted while it was read")
        yield content
        size -= len(content)
        number += 1


def _of(table: sa.Table, owner: Mapping[str, str]) -> list[Any]:
    return [table.c[name] == value for name, value in owner.items()]
