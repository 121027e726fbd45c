"""`rehyb pilots`: workers that a batch system starts."""

import json
import time
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from intake.words import counted
from rehyb.cli.answers import AsJson, Token, Url
from rehyb.cli.options import interruptible, optional
from rehyb.client import Client
from rehyb.pilots.keeper import Keeper, Status


def pilots(
    file: Annotated[Path, typer.Argument(help="What pilots are like and how many; TOML.")],
    directory: Annotated[
        Path | None,
        optional(
            help="Scripts and logs of the jobs, seen by them too. "
            "Default: named after FILE, beside it."
        ),
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Keep as many workers running in a batch system as there is work for.

    Prints a line whenever something changes. Ctrl-C or SIGTERM has every pilot finish what it runs
    and leave; a second one cancels their jobs at once.
    """
    from rehyb.fleet import locked
    from rehyb.pilots.engines import ENGINES, ParslEngine
    from rehyb.pilots.settings import read

    settings = read(file)
    folder = (directory or file.parent / f"{file.stem}-pilots").resolve()
    seconds = ENGINES[settings.provider].look_seconds
    with Client(url, token) as client, interruptible():
        engine = ParslEngine(
            settings.provider,
            folder=folder,
            walltime=settings.walltime,
            cores=settings.cores,
            before=settings.before,
            options=settings.options,
        )
        # Whoever cannot ask would start nothing, and nobody might see why.
        client.work()
        with closing(locked(folder / "lock")):
            keeper = Keeper(
                settings=settings,
                engine=engine,
                client=client,
                token=client.token,
                folder=folder,
            )
            keeper.prepare()
            told = _Telling(as_json)
            try:
                while True:
                    told(keeper.look(time.monotonic()))
                    time.sleep(seconds)
            except KeyboardInterrupt:
                keeper.drain(time.sleep, told)
            finally:
                keeper.end()


class _Telling:
    """Prints how things stand, if it has changed."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._last: Status | None = None

    def __call__(self, status: Status) -> None:
        if status != self._last:
            typer.echo(json.dumps(asdict(status)) if self._as_json else line(status))
        self._last = status


def line(status: Status) -> str:
    """Return how things stand as one line."""
    leaving = f"{status.pilots_leaving} leaving, " if status.pilots_leaving else ""
    text = (
        f"{counted(status.waiting, 'instance waits', 'instances wait')}, "
        f"{status.under_way} under way; pilots: "
        f"{status.pilots_running} running, {status.pilots_waiting} queued, {leaving}"
        f"{status.wanted} wanted"
    )
    return f"{text}; {status.trouble}" if status.trouble else text
