"""Commands that start what runs for long: `up`, `coordinator`, `analysis`."""

import os
import signal
import threading
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.answers import Answer, AsJson, answering, print_json
from rehyb.cli.operate.database import in_one_sentence, opened
from rehyb.cli.options import interruptible
from rehyb.client import Client
from rehyb.errors import Invalid, RehybError, needs_extra

SUPERVISE_SECONDS = 1.0


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

    Starts a coordinator, its analysis and some workers, and restarts what dies. A database that is
    away is waited for.

    REHYB_TOKEN and REHYB_DATABASE_URL are honoured; without them a token and a SQLite database are
    kept in the directory.
    """
    # What it starts would only say so in a log.
    for name in ("fastapi", "uvicorn", "sqlalchemy", "alembic", "pydantic_settings"):
        if find_spec(name) is None:
            raise RehybError(f"rehyb up needs {name}: pip install 'rehyb[server]'")
    from models.running.pool import available_cores
    from rehyb.fleet import LocalFleet

    if not directory.exists():
        from server.run import listening

        # Before anything is made there: the coordinator itself finds out too late for that.
        with in_one_sentence():
            listening(host, port).close()
    fleet = LocalFleet(
        directory,
        workers=available_cores() if workers is None else workers,
        host=host,
        port=port,
        token=os.environ.get("REHYB_TOKEN"),
        database_url=os.environ.get("REHYB_DATABASE_URL"),
        say=lambda sentence: typer.echo(sentence, err=True),
    )
    with interruptible(), fleet:
        with Client(fleet.url, fleet.token) as client:
            page = client.page_address()
        if as_json:
            said = {"url": fleet.url, "token": fleet.token, "logs": str(fleet.directory)}
            print_json({**said, "page": page})
        else:
            typer.echo(
                f"The coordinator listens on {fleet.url}; logs are in {fleet.directory}/logs.\n"
                f"In a browser, once and within an hour (later: `rehyb page`):\n\n"
                f"  {page}\n\n"
                f"In another terminal:\n\n"
                f"  export REHYB_URL={fleet.url} REHYB_TOKEN={fleet.token}\n"
                f"  rehyb study submit --model ishigami --method morris --rows 100\n\n"
                f"Ctrl-C stops everything."
            )
        while True:
            fleet.supervise()
            time.sleep(SUPERVISE_SECONDS)


@answering
def page(client: Client) -> Answer:
    """Print an address of the coordinator's pages that signs a browser in, once, within an hour."""
    address = client.page_address()
    return Answer({"page": address}, address)


def coordinator() -> None:
    """Serve the REST API until SIGTERM or Ctrl-C; a database that is away is waited for.

    REHYB_TOKEN (required), REHYB_DATABASE_URL, REHYB_HOST, REHYB_PORT, REHYB_LEASE_SECONDS,
    REHYB_STRANDED_SECONDS, REHYB_RECOMPUTE_SHARE, REHYB_RECOMPUTE_TOLERANCE,
    REHYB_SESSION_BYTES, REHYB_DURABILITY, REHYB_LOG_LEVEL,
    REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY configure it.
    """
    with needs_extra("rehyb coordinator", "server"):
        from pydantic import ValidationError

        from server.run import serve
        from server.settings import Settings, objection

    try:
        settings = Settings()
    except ValidationError as error:
        raise Invalid(objection(error)) from None
    with in_one_sentence():
        serve(settings)


def analysis() -> None:
    """Turn results into indices as they arrive.

    Runs until SIGTERM or Ctrl-C; a database that is away, or that no coordinator has made or
    brought to this version yet, is waited for. REHYB_DATABASE_URL names the coordinator's database.
    Several may run: whoever commits first wins, and the others carry on from there.
    """
    with needs_extra("rehyb analysis", "server"):
        from analysis.sensitivity.service import follow
        from server.logs import configure
        from server.operations.study.result_log import StoreResultLog
        from server.store.database.presence import why_away

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    configure("warning")
    with opened(stop=stop) as engine:
        follow(StoreResultLog(engine), stop=stop, why_away=why_away)
