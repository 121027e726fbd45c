"""Models: rehyb's own, uploaded ones, and those that workers announce."""

from collections.abc import Iterable
from typing import BinaryIO

from sqlalchemy.engine import Connection, Engine

from models.description import Description, Kind
from server.errors import ConflictError, InvalidStudyError, NotFoundError
from server.records import ModelVersion
from server.store import models
from server.store.database.engine import alone_reading, reading, writing

every = alone_reading(models.every)
wanted = alone_reading(models.wanted)
archive = models.archive


def get(engine: Engine, called: str) -> ModelVersion:
    """Return a model by its name (its newest version) or "name@digest".

    Raises:
        NotFoundError: there is none.
    """
    with reading(engine) as connection:
        found = models.find(connection, called)
    if found is None:
        raise NotFoundError(f"there is no model {called!r}")
    return found


def to_sample(engine: Engine, called: str) -> ModelVersion:
    """Return the model that a study asks for.

    Raises:
        InvalidStudyError: there is none.
    """
    with reading(engine) as connection:
        found = models.find(connection, called)
        if found is None:
            known = ", ".join(model.name for model in models.every(connection))
            raise InvalidStudyError(
                "/model",
                f"unknown model {called!r}: expected one of {known}; one of your own is added "
                "first (rehyb model add DIR)",
            )
    return found


def register_built_in(engine: Engine, descriptions: Iterable[Description], *, now: float) -> None:
    """Store the models that come with this version of rehyb."""
    found = [_version(description, own=True, by="", now=now) for description in descriptions]
    with writing(engine) as connection:
        models.put_all(connection, found)


def announce(engine: Engine, description: Description, *, by: str, now: float) -> ModelVersion:
    """Store the description of a model whose code is with workers.

    Raises:
        ConflictError: it must be uploaded, or its name is one of rehyb's own, or of an uploaded
            model, which studies of that name mean.
    """
    if description.kind == Kind.MJCF:
        raise ConflictError("a model of kind mjcf is uploaded whole: send its zip file")
    model = _version(description, own=False, by=by, now=now)
    with writing(engine) as connection:
        known = _check_name(connection, model)
        if known is not None and known.size:
            raise ConflictError(
                f"{model.name} is a model of kind {known.description.kind} that somebody uploaded: "
                f"give this one of kind {description.kind} another name"
            )
        models.put(connection, model)
    return model


def upload(
    engine: Engine, description: Description, file: BinaryIO, *, size: int, now: float
) -> tuple[ModelVersion, bool]:
    """Store a model that passed the check, and its zip file.

    Returns:
        The model, and whether this version of it is new.

    Raises:
        ConflictError: its name is one of rehyb's own.
    """
    model = _version(description, own=False, by="", now=now, size=size)
    with writing(engine) as connection:
        _check_name(connection, model)
        new = models.put(connection, model)
        if new:
            models.put_archive(connection, model.version, file)
            return model, True
        first = models.find(connection, model.version)
    # It was there a moment ago, in the same transaction.
    assert first is not None
    return first, False


def _version(
    description: Description, *, own: bool, by: str, now: float, size: int = 0
) -> ModelVersion:
    return ModelVersion(
        version=description.version,
        name=description.name,
        description=description,
        own=own,
        announced_by=by,
        announced_at=now,
        size=size,
    )


def _check_name(connection: Connection, model: ModelVersion) -> ModelVersion | None:
    """Return the model that has this name so far, which may be none of rehyb's own."""
    known = models.find(connection, model.name)
    if known is not None and known.own:
        raise ConflictError(f"{model.name} is a model of rehyb's own: choose another name")
    return known
