"""Would a worker do well on this machine? `rehyb-worker doctor` looks before a night is lost."""

import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from enum import StrEnum
from pathlib import Path

from models.running.pool import available_cores
from rehyb.client import Client
from rehyb.errors import RehybError, Unauthorized
from sim.evaluation import code
from worker.machine import canary, cpu
from worker.spool import no_place

#: An assessment takes 0.4 s on a core of 2020; one that takes ten times as long is hardly a help.
SLOW_SECONDS = 4.0
#: Only the coordinator's clock decides anything; but logs of different machines should agree.
CLOCK_SECONDS = 60.0
#: A spool of a night without a coordinator, with room to spare.
SPOOL_BYTES = 200_000_000


class Severity(StrEnum):
    """How bad a finding is: only a failure keeps a worker from working."""

    OK = "ok"
    WARNING = "warning"
    FAILURE = "failure"


#: How bad it is, and one sentence: what is, and what would be right.
Judgement = tuple[Severity, str]


@dataclass(frozen=True)
class Finding:
    """What one check found."""

    check: str
    verdict: Severity
    detail: str


def examine(*, spool: Path, connect: Callable[[], Client]) -> Iterator[Finding]:
    """Yield findings, one per check, as they are made."""
    yield Finding("processor", *_processor())
    yield Finding("simulation", *_simulation())
    yield Finding("spool", *_disk(spool))
    try:
        with connect() as client:
            health = client.health()
            yield Finding("coordinator", Severity.OK, f"{client.url} answers")
            yield Finding("clock", *_clock(health.get("date")))
            yield Finding("token", *_token(client))
    except RehybError as error:
        yield Finding("coordinator", Severity.FAILURE, str(error))


def _processor() -> Judgement:
    cores = available_cores()
    found = cpu()
    if found == "unknown":
        return Severity.OK, f"{cores} cores for this process"
    if {"avx", "asimd"} & set(found.split()):
        return Severity.OK, f"{cores} cores for this process, with {found}"
    detail = f"{cores} cores without AVX: MuJoCo's own builds ask for it on x86-64"
    return Severity.WARNING, detail


def _simulation() -> Judgement:
    try:
        digest, seconds, _ = canary()
    except RehybError as error:
        return Severity.FAILURE, str(error)
    detail = f"the nominal elbow took {seconds:.2f} s; code {code()}, canary {digest}"
    if seconds > SLOW_SECONDS:
        return Severity.WARNING, f"{detail}: that is slow"
    return Severity.OK, detail


def _disk(spool: Path) -> Judgement:
    probe = spool / ".doctor"
    try:
        spool.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"x")
        probe.unlink()
        free = shutil.disk_usage(spool).free
    except OSError as error:
        return Severity.FAILURE, no_place(spool, error)
    detail = f"{free / 1e9:.1f} GB are free for results in {spool}"
    if free < SPOOL_BYTES:
        return Severity.WARNING, f"only {detail}"
    return Severity.OK, detail


def _clock(date: str | None) -> Judgement:
    if date is None:
        return Severity.WARNING, "the coordinator tells no time"
    apart = time.time() - parsedate_to_datetime(date).timestamp()
    detail = f"{abs(apart):.0f} s apart from the coordinator's"
    if abs(apart) > CLOCK_SECONDS:
        detail += ": nothing is lost by that, but its log will not agree with others'"
        return Severity.WARNING, detail
    return Severity.OK, detail


def _token(client: Client) -> Judgement:
    try:
        client.workers()
    except Unauthorized as error:
        # A worker's own token need not be good for reading.
        if error.problem.get("status") != 403:
            return Severity.FAILURE, str(error)
    return Severity.OK, "the coordinator knows it"
