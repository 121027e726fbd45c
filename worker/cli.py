"""The `rehyb-worker` command."""

import hashlib
import json
import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import partial
from math import inf
from pathlib import Path
from random import Random
from typing import Annotated, Any

import typer

from models.running.places import NoModelError, Places
from models.running.pool import Pool, available_cores
from rehyb.client import DEFAULT_URL, Client
from rehyb.durations import seconds
from rehyb.errors import Invalid, RehybError
from rehyb.streams import print_any_character
from rehyb.threads import limit_threads
from worker.agent import Agent
from worker.banks import usable_bank
from worker.close_loop.child import can_close_loops
from worker.close_loop.child import work as work_on_session
from worker.close_loop.jobs import CloseLoopJobs
from worker.doctor import Severity, examine
from worker.leases import Leases
from worker.machine import describe, new_id
from worker.models.canaries import Canaries
from worker.models.offered import WorkerModels
from worker.renewing import Renewals
from worker.spool import Spool

#: Seconds to wait for an answer: to a renewal, well under a lease's time to live; and to all else,
#: since what is taken for lost on a slow way is done again.
ANSWER_SECONDS = 10.0
PATIENCE_SECONDS = 30.0
#: The shortest --lifetime, seconds.
SHORTEST_LIFE = 10.0
#: A signal that comes again within so many seconds is the same one.
SAME_SIGNAL_SECONDS = 0.5

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


#: An option that may be left out; its help says what holds then.
optional = partial(typer.Option, show_default=False)
Url = Annotated[str | None, optional(help="The coordinator. Default: REHYB_URL.")]
Token = Annotated[
    str | None,
    optional(help="Its token. Default: REHYB_TOKEN, which other users of the machine cannot see."),
]
SpoolFolder = Annotated[
    Path | None,
    optional(
        help="Where results wait until the coordinator has them. "
        "Default: a folder per coordinator under ~/.local/state/rehyb."
    ),
]


@app.callback(invoke_without_command=True)
def work(
    context: typer.Context,
    url: Url = None,
    token: Token = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Instances to run at once. Default: one per core.")
    ] = None,
    max_idle: Annotated[
        float | None,
        typer.Option(min=0.0, help="Leave after this many seconds without work. Default: never."),
    ] = None,
    batch: Annotated[
        int,
        typer.Option(
            min=1,
            max=1000,
            help="The most instances to ask for at once; fewer if they are two seconds of work.",
        ),
    ] = 1000,
    instance_seconds: Annotated[
        float, typer.Option(min=0.1, help="Kill an instance that runs for longer.")
    ] = 120.0,
    max_instances: Annotated[
        int | None,
        optional(min=1, help="Leave after this many. Default: never."),
    ] = None,
    lifetime: Annotated[
        str | None,
        optional(
            metavar="TIME",
            help="Be gone after this time, as 90s, 30m or 2h: nothing is begun that would last "
            "longer. Default: stay.",
        ),
    ] = None,
    memory_mb: Annotated[
        int | None,
        optional(
            min=100,
            help="Memory one instance may take, in MB; beyond it, it has crashed. Default: no end.",
        ),
    ] = None,
    loop_seconds: Annotated[
        float, typer.Option(min=1.0, help="Give up closing a loop that takes longer.")
    ] = 1800.0,
    loop_memory_mb: Annotated[
        int, typer.Option(min=500, help="Memory that closing a loop may take, in MB.")
    ] = 4096,
    bank: Annotated[
        Path | None,
        optional(
            metavar="FILE.npz",
            help="Interpret sessions by this bank. Default: as of `rehyb interpret`, if there is "
            "one.",
        ),
    ] = None,
    tags: Annotated[
        str, typer.Option(help="What this machine is good for, comma-separated: lab-2,fast.")
    ] = "",
    host: Annotated[
        str | None,
        optional(
            help="What this machine is called, of which containers know only a made-up name. "
            "Default: its host name."
        ),
    ] = None,
    spool: SpoolFolder = None,
    models: Annotated[
        list[Path] | None,
        optional(
            metavar="DIR",
            help="A folder with a model.toml, or with such folders: its program runs here; repeat.",
        ),
    ] = None,
    allow: Annotated[
        list[str] | None,
        optional(
            metavar="NAME",
            help="A model that a package announces here as rehyb.models: its code runs; repeat.",
        ),
    ] = None,
    umbridge: Annotated[
        list[str] | None,
        optional(
            metavar="URL",
            help="A server that evaluates models of kind umbridge in --models; repeat.",
        ),
    ] = None,
) -> None:
    """Compute instances for a coordinator until told to stop.

    SIGTERM or Ctrl-C finishes what runs, posts it and releases the rest; a second one releases at
    once. Results that cannot be posted wait on disk for the next worker on this machine.
    """
    if context.invoked_subcommand is not None:
        return
    leave_at = inf if lifetime is None else time.monotonic() + _lifetime(lifetime)
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(message)s",
        datefmt="%Y-%m-%d %H:%M:%S",
    )
    # A line per request would bury everything else.
    logging.getLogger("httpx2").setLevel(logging.WARNING)
    count = processes or available_cores()
    with (
        Client(url, token, timeout=PATIENCE_SECONDS) as client,
        Client(url, token, timeout=ANSWER_SECONDS) as second_client,
    ):
        client.answer_by = second_client.answer_by = leave_at
        versions, own = describe()
        worker: dict[str, Any] = {
            "id": new_id(os.environ.get("REHYB_WORKER_GROUP", "")),
            "host": host or socket.gethostname(),
            "versions": versions,
            "tags": [tag.strip() for tag in tags.split(",") if tag.strip()],
        }
        folder = spool or _default_spool(client.url)
        places = Places(fetch=client.model_archive, cache=_state() / "models")
        left_out = partial(logging.warning, "left out: %s")
        places.have(models or (), allow or (), umbridge or (), left_out)
        beside = Pool(1, instance_seconds, memory_mb=memory_mb)
        canaries = Canaries(pool=beside)
        offered = WorkerModels(
            client=client, worker=worker["id"], places=places, canaries=canaries, own=own
        )
        leases = Leases(
            client=client,
            worker=worker,
            models=offered.offered,
            refused=offered.refused,
            processes=count,
            batch=batch,
            left=max_instances,
            leave_at=leave_at,
            rng=Random(),
        )
        agent = Agent(
            leases=leases,
            renewals=Renewals(
                renew=partial(leases.renew, second_client), patience=leases.patience, rng=Random()
            ),
            pool=Pool(count, instance_seconds, memory_mb=memory_mb),
            spool=Spool(folder, worker["id"]),
            max_idle=max_idle,
            rng=Random(),
            prepare=places.prepared,
            check_models=canaries.look,
            lose_model=canaries.lose,
            # Nobody knows how long closing a loop takes: not where the time is limited.
            close_loop_jobs=None
            if leave_at < inf
            else _close_loop_jobs(
                second_client,
                Pool(1, loop_seconds, evaluate=work_on_session, memory_mb=loop_memory_mb),
                folder / "loops",
                worker,
                bank,
            ),
        )
        stop = _once_in_a_while(agent.stop)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        logging.info("worker %s: %d processes for %s", worker["id"], count, client.url)
        logging.info("%s", abilities(places.descriptions, agent.close_loop_jobs, leave_at < inf))
        try:
            agent.run()
        finally:
            beside.kill()


def _lifetime(text: str) -> float:
    """Return --lifetime in seconds; Invalid if it is no time, or too short to do anything in."""
    found = seconds(text, "--lifetime")
    if found < SHORTEST_LIFE:
        raise Invalid(f"--lifetime {text} is too short: give it {SHORTEST_LIFE:g} s at least")
    return found


def _once_in_a_while(stop: Callable[[], None]) -> Callable[..., None]:
    """Return a signal handler for which signals in quick succession are one.

    A batch system may signal a worker and the shell that started it, which passes it on.
    """
    last = -inf

    def handler(*_: object) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= SAME_SIGNAL_SECONDS:
            stop()
        last = now

    return handler


def _close_loop_jobs(
    client: Client, pool: Pool, folder: Path, worker: dict[str, Any], bank: Path | None
) -> CloseLoopJobs | None:
    """Return what closes loops here, and interprets; None if this installation cannot."""
    if not can_close_loops():
        if bank is not None:
            raise Invalid("to interpret takes pictures: pip install 'rehyb[figures]'")
        return None
    from analysis.closeloop.code import digest

    return CloseLoopJobs(
        client=client,
        pool=pool,
        folder=folder,
        worker=worker,
        code=digest(),
        bank=usable_bank(bank),
        rng=Random(),
    )


def abilities(named: Iterable[str], jobs: CloseLoopJobs | None, leaves: bool) -> str:
    """Return in a sentence what a worker can do.

    Args:
        named: versions of the models that its owner named.
        jobs: None: it closes no loops.
        leaves: it does not stay for long.
    """
    models = ", ".join(["rehyb's own", "uploaded ones", *named])
    if jobs is None:
        why = "with --lifetime" if leaves else "without pip install 'rehyb[figures]'"
        return f"evaluates models: {models}; closes no loops {why}"
    bank = f"interprets by bank {jobs.bank[0]}" if jobs.bank else "interprets nothing: no bank"
    return f"evaluates models: {models}; closes loops; {bank}"


@app.command()
def doctor(
    url: Url = None,
    token: Token = None,
    spool: SpoolFolder = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Check this machine and its way to the coordinator; exit status 1 if a worker would fail."""
    folder = spool or _default_spool(url or os.environ.get("REHYB_URL") or DEFAULT_URL)
    found = []
    for finding in examine(spool=folder, connect=lambda: Client(url, token, ANSWER_SECONDS)):
        found.append(finding)
        if not as_json:
            print(f"{finding.verdict:8} {finding.check:12} {finding.detail}", flush=True)
    if as_json:
        print(json.dumps([asdict(finding) for finding in found], indent=2))
    if any(finding.verdict == Severity.FAILURE for finding in found):
        raise typer.Exit(1)


def _default_spool(url: str) -> Path:
    """Return the folder for results meant for `url`: another coordinator must not get them."""
    return _state() / "spool" / hashlib.sha256(url.encode()).hexdigest()[:16]


def _state() -> Path:
    """Return the folder for what workers keep on this machine."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "rehyb"


def main() -> None:
    """Run the command; a failure is one sentence on stderr and exit status 1."""
    limit_threads()
    print_any_character()
    try:
        app(prog_name="rehyb-worker")
    except (RehybError, NoModelError) as error:
        print(f"rehyb-worker: {error}", file=sys.stderr)
        sys.exit(1)
