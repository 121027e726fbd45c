"""The schema comes to be, and changes, through the migrations only."""

from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import inspect
from sqlalchemy.engine import Connection, Engine

import migrations
from server.errors import OldSchemaError, OtherDatabaseError, SchemaError
from server.store.database.engine import create_engine, reading, writing
from server.store.database.files import of_another, of_another_in_sqlite

#: Any number, as long as every version of this program takes the same PostgreSQL advisory lock.
_UPGRADE_LOCK = 827_346_501


def upgrade(url: str) -> None:
    """Bring the database at `url` to this version's schema, making it if there is none.

    All or nothing, and safe to call from several processes at once.

    Raises:
        SchemaError: the database was made by a newer version.
        OtherDatabaseError: it is somebody else's; it stays as it was.
    """
    engine = create_engine(url)
    try:
        with writing(engine) as connection:
            if connection.dialect.name == "postgresql":
                connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_UPGRADE_LOCK})")
            if _current(connection) != _head():
                command.upgrade(_config(connection), "head")
    finally:
        engine.dispose()


def require_current(engine: Engine) -> None:
    """Raise SchemaError unless the database has this version's schema.

    Raises:
        OldSchemaError: it has none, or an older one.
        OtherDatabaseError: it is somebody else's.
    """
    with reading(engine) as connection:
        current, head = _current(connection), _head()
    if current != head:
        raise OldSchemaError(
            f"the database has schema {current or 'none'}, this rehyb works with {head}: "
            "run `rehyb db upgrade`"
        )


def has_schema(engine: Engine) -> bool:
    """Say whether the database has a schema of rehyb, of whatever version; SchemaError: a newer."""
    with reading(engine) as connection:
        return _current(connection) is not None


def _location() -> Config:
    """Return an Alembic configuration that knows where the migrations are, without any file."""
    config = Config()
    config.set_main_option("script_location", str(Path(str(migrations.__file__)).parent))
    config.set_main_option("path_separator", "os")
    return config


def _config(connection: Connection) -> Config:
    """Return one that works on `connection`."""
    config = _location()
    config.attributes["connection"] = connection
    return config


@cache
def _scripts() -> ScriptDirectory:
    """Return this version's migrations, which take longer to read than a database to open."""
    return ScriptDirectory.from_config(_location())


def _head() -> str:
    """Return the newest schema this version knows."""
    head = _scripts().get_current_head()
    if head is None:
        raise SchemaError("this installation of rehyb has no migrations: install it again")
    return head


def _current(connection: Connection) -> str | None:
    """Return the database's schema, None if it is empty.

    Raises:
        SchemaError: it is unknown here.
        OtherDatabaseError: what the schema in use holds is not rehyb's.
    """
    if others := _of_another(connection):
        raise OtherDatabaseError(others)
    current = MigrationContext.configure(connection).get_current_revision()
    known = {script.revision for script in _scripts().walk_revisions()}
    if current is not None and current not in known:
        raise SchemaError(
            f"the database has schema {current}, which this rehyb does not know (its newest is "
            f"{_head()}): it was made by a newer version; upgrade rehyb"
        )
    return current


def _of_another(connection: Connection) -> str:
    if connection.dialect.name == "sqlite":
        return of_another_in_sqlite(connection.connection.dbapi_connection)
    found = inspect(connection)
    return of_another(found.get_table_names(), found.get_view_names())
