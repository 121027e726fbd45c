"""Models and their zip files."""

from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection, Engine

from models.description import Description
from server.errors import NotFoundError
from server.records import ModelVersion
from server.states import StudyState
from server.store.database import parts
from server.store.database.engine import insert
from server.store.database.prepared import Prepared, text
from server.store.database.schema import model_parts, models, studies

#: Of a version, as `description_of` takes it.
DESCRIPTION = Prepared(
    sa.select(text(models.c.description)).where(models.c.version == sa.bindparam("version"))
)


def put_all(connection: Connection, found: Sequence[ModelVersion]) -> None:
    """Store models, or when and by whom they were announced again, by one statement."""
    statement = insert(connection, models)
    again = {name: statement.excluded[name] for name in ("announced_by", "announced_at")}
    statement = statement.on_conflict_do_update(index_elements=["version"], set_=again)
    connection.execute(statement, [_row(model) for model in found])


def put(connection: Connection, model: ModelVersion) -> bool:
    """Store a model, or when and by whom it was announced again; whether it is new."""
    statement = insert(connection, models).values(_row(model))
    statement = statement.on_conflict_do_nothing(index_elements=["version"])
    # Not every driver counts inserted rows, but all return them.
    if connection.scalar(statement.returning(models.c.version)) is not None:
        return True
    again = sa.update(models).where(models.c.version == model.version)
    connection.execute(
        again.values(announced_by=model.announced_by, announced_at=model.announced_at)
    )
    return False


def put_archive(connection: Connection, version: str, file: BinaryIO) -> None:
    """Store the zip file of a new model."""
    parts.write(connection, model_parts, {"version": version}, file)


def find(connection: Connection, called: str) -> ModelVersion | None:
    """Return a model by "name@digest", or the version of a name that was announced last."""
    key = models.c.version if "@" in called else models.c.name
    query = sa.select(models).where(key == called).order_by(*_LATEST_FIRST).limit(1)
    row = connection.execute(query).one_or_none()
    return None if row is None else _model(row)


def every(connection: Connection) -> list[ModelVersion]:
    """Return the version of each model that was announced last, rehyb's own first."""
    query = sa.select(models).order_by(models.c.own.desc(), models.c.name, *_LATEST_FIRST)
    latest: dict[str, ModelVersion] = {}
    for row in connection.execute(query):
        if row.name not in latest:
            latest[row.name] = _model(row)
    return list(latest.values())


def wanted(connection: Connection) -> list[ModelVersion]:
    """Return the models, other than rehyb's own, that studies sample which are not over."""
    over = (StudyState.COMPLETE, StudyState.CANCELLED)
    sampled = sa.select(studies.c.model).where(studies.c.state.not_in(over))
    query = sa.select(models).where(models.c.version.in_(sampled)).order_by(models.c.version)
    return [_model(row) for row in connection.execute(query)]


def archive(engine: Engine, model: ModelVersion) -> Iterator[bytes]:
    """Yield a model's zip file, a part at a time, each in a transaction of its own.

    Raises:
        NotFoundError: its code is with workers.
    """
    if not model.size:
        raise NotFoundError(f"{model.version} was never uploaded: its code is with workers")
    return parts.read(engine, model_parts, {"version": model.version}, model.size)


_LATEST_FIRST = (models.c.announced_at.desc(), models.c.version)


def description_of(row: Sequence[Any]) -> Description:
    """Return the description that a row of `DESCRIPTION` holds."""
    return Description.from_json(from_json(row[0]), kept=True)


def _row(model: ModelVersion) -> dict[str, Any]:
    return {**vars(model), "description": model.description.as_json()}


def _model(row: sa.Row[Any]) -> ModelVersion:
    values = dict(row._mapping)
    description = Description.from_json(values["description"], kept=True)
    return ModelVersion(**values | {"description": description})
