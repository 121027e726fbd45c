"""The `rehyb-worker` command."""

import hashlib
import logging
import os
import secrets
import signal
import socket
import sys
from pathlib import Path
from random import Random
from typing import Annotated

import typer

from rehyb.client import Client
from rehyb.errors import RehybError
from sim.catalogue import MODELS
from sim.evaluation import versions
from worker.agent import Agent
from worker.pool import Pool, available_cores
from worker.spool import Spool

#: Seconds to wait for one answer: well under a lease's time to live, so that leases stay renewed.
ANSWER_SECONDS = 10.0

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def work(
    url: Annotated[
        str | None, typer.Option(help="The coordinator. Default: REHYB_URL.", show_default=False)
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(
            help="Its token. Default: REHYB_TOKEN, which other users of the machine cannot see.",
            show_default=False,
        ),
    ] = None,
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="Instances to run at once. Default: one per core."),
    ] = None,
    max_idle: Annotated[
        float | None,
        typer.Option(min=0.0, help="Leave after this many seconds without work. Default: never."),
    ] = None,
    batch: Annotated[
        int, typer.Option(min=1, max=1000, help="The most instances to ask for at once.")
    ] = 10,
    instance_seconds: Annotated[
        float, typer.Option(min=0.1, help="Kill an instance that runs for longer.")
    ] = 120.0,
    spool: Annotated[
        Path | None,
        typer.Option(
            help="Where results wait until the coordinator has them. "
            "Default: a folder per coordinator under ~/.local/state/rehyb.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compute instances for a coordinator until told to stop.

    SIGTERM or Ctrl-C finishes what runs, posts it and releases the rest; a second one releases at
    once. Results that cannot be posted wait on disk for the next worker on this machine.
    """
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", datefmt="%H:%M:%S"
    )
    # A line per request would bury everything else.
    logging.getLogger("httpx2").setLevel(logging.WARNING)
    count = processes or available_cores()
    worker = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
    with Client(url, token, timeout=ANSWER_SECONDS) as client:
        agent = Agent(
            client=client,
            pool=Pool(count, instance_seconds),
            spool=Spool(spool or _default_spool(client.url), worker),
            worker={"id": worker, "host": socket.gethostname(), "versions": versions()},
            models=tuple(MODELS),
            batch=batch,
            max_idle=max_idle,
            rng=Random(),
        )
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: agent.stop())
        logging.info("worker %s: %d processes for %s", worker, count, client.url)
        agent.run()


def _default_spool(url: str) -> Path:
    """Return the folder for results meant for `url`: another coordinator must not get them."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "rehyb" / "spool" / hashlib.sha256(url.encode()).hexdigest()[:16]


def main() -> None:
    """Run the command; a failure is one sentence on stderr and exit status 1."""
    try:
        app(prog_name="rehyb-worker")
    except RehybError as error:
        print(f"rehyb-worker: {error}", file=sys.stderr)
        sys.exit(1)
