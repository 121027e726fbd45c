"""Commands that start what runs for long: `up`, `coordinator`, `analysis`, `db`."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.options import AsJson, interruptible, print_json
from rehyb.errors import Invalid, RehybError

database = typer.Typer(help="The coordinator's database.", no_args_is_help=True)

SUPERVISE_SECONDS = 1.0
#: Between two looks of the analysis for news.
POLL_SECONDS = 0.5


def up(
    directory: Annotated[
        Path, typer.Option(help="Where database, token, spool and logs are kept.")
    ] = Path(".rehyb"),
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Workers to run on this machine. Default: one per core."),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            envvar="REHYB_HOST", help="Address to listen on; 0.0.0.0 admits other machines."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, envvar="REHYB_PORT", help="0 takes any free port.")
    ] = 8787,
    as_json: AsJson = False,
) -> None:
    """Run everything on this machine until Ctrl-C.

    Starts a coordinator, its analysis and some workers, and restarts what dies.

    REHYB_TOKEN and REHYB_DATABASE_URL are honoured; without them a token and a SQLite database are
    kept in the directory.
    """
    from rehyb.fleet import LocalFleet
    from worker.pool import available_cores

    fleet = LocalFleet(
        directory,
        workers=available_cores() if workers is None else workers,
        host=host,
        port=port,
        token=os.environ.get("REHYB_TOKEN"),
        database_url=os.environ.get("REHYB_DATABASE_URL"),
    )
    with interruptible(), fleet:
        if as_json:
            print_json({"url": fleet.url, "token": fleet.token, "logs": str(fleet.directory)})
        else:
            typer.echo(
                f"The coordinator listens on {fleet.url}; logs are in {fleet.directory}/logs.\n"
                f"In another terminal:\n\n"
                f"  export REHYB_URL={fleet.url} REHYB_TOKEN={fleet.token}\n"
                f"  rehyb study submit --model ishigami --method morris --rows 100\n\n"
                f"Ctrl-C stops everything."
            )
        while True:
            fleet.supervise()
            time.sleep(SUPERVISE_SECONDS)


def coordinator() -> None:
    """Serve the REST API until SIGTERM or Ctrl-C.

    REHYB_TOKEN (required), REHYB_DATABASE_URL, REHYB_HOST, REHYB_PORT, REHYB_LEASE_SECONDS,
    REHYB_STRANDED_SECONDS, REHYB_RECOMPUTE_SHARE, REHYB_RECOMPUTE_TOLERANCE, REHYB_LOG_LEVEL,
    REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY configure it.
    """
    from pydantic import ValidationError

    from server.run import serve
    from server.settings import Settings

    try:
        settings = Settings()
    except ValidationError as error:
        fault = error.errors()[0]
        # What concerns several settings has no place of its own, and names them itself.
        name = f"REHYB_{fault['loc'][0]}: ".upper() if fault["loc"] else ""
        raise Invalid(f"{name}{fault['msg'].removeprefix('Value error, ')}") from None
    with in_one_sentence():
        serve(settings)


def analysis() -> None:
    """Turn results into indices as they arrive.

    Runs until SIGTERM or Ctrl-C. REHYB_DATABASE_URL names the coordinator's database. Several may
    run: whoever commits first wins, and the others carry on from there.
    """
    from analysis.sensitivity.service import follow
    from server.store import create_engine, require_current
    from server.store.result_log import StoreResultLog

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    with in_one_sentence():
        engine = create_engine(database_url())
        try:
            require_current(engine)
            follow(StoreResultLog(engine), stop=stop, poll_seconds=POLL_SECONDS)
        finally:
            engine.dispose()


@database.command("upgrade")
def upgrade_database(as_json: AsJson = False) -> None:
    """Bring the database at REHYB_DATABASE_URL to this version's schema."""
    from server.store import upgrade

    with in_one_sentence():
        url = database_url()
        upgrade(url)
    if as_json:
        print_json({"upgraded": True})
    else:
        typer.echo("the database has the schema of this version")


@database.command()
def backup(
    file: Annotated[Path, typer.Argument(help="The copy; must not exist.")],
    as_json: AsJson = False,
) -> None:
    """Copy the SQLite database at REHYB_DATABASE_URL, also while a coordinator uses it."""
    from server.store import check, create_engine, require_current

    with in_one_sentence():
        engine = create_engine(database_url())
        try:
            require_current(engine)
            check.back_up(engine, file)
        finally:
            engine.dispose()
    if as_json:
        print_json({"file": str(file)})
    else:
        typer.echo(str(file))


@database.command("check")
def check_database(as_json: AsJson = False) -> None:
    """Count everything anew; exit status 1 if the database contradicts itself."""
    from server.store import check, create_engine, require_current

    with in_one_sentence():
        engine = create_engine(database_url())
        try:
            require_current(engine)
            found = check.faults(engine)
        finally:
            engine.dispose()
    if as_json:
        print_json({"faults": found})
    else:
        typer.echo("\n".join(found) or "the database is whole")
    if found:
        raise typer.Exit(1)


def database_url() -> str:
    """Return the database's URL from the environment; a token is not needed to use it."""
    from server.settings import Settings

    default: str = Settings.model_fields["database_url"].default
    return os.environ.get("REHYB_DATABASE_URL", default)


@contextmanager
def in_one_sentence() -> Iterator[None]:
    """Turn what the coordinator's rooms raise at start into this command's errors."""
    from sqlalchemy.exc import SQLAlchemyError

    from server.errors import CoordinatorError

    try:
        yield
    except (CoordinatorError, OSError) as error:
        raise RehybError(str(error)) from error
    except SQLAlchemyError as error:
        cause = str(getattr(error, "orig", None) or error).splitlines()[0]
        raise RehybError(f"the database cannot be used: {cause}") from error
