"""Would a worker do well on this machine? `rehyb-worker doctor` looks before a night is lost."""

import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from pathlib import Path

from rehyb.client import Client
from rehyb.errors import RehybError, Unauthorized
from worker.machine import canary, code, cpu
from worker.pool import available_cores

#: An assessment takes 0.4 s on a core of 2020; one that takes ten times as long is hardly a help.
SLOW_SECONDS = 4.0
#: Only the coordinator's clock decides anything; but logs of different machines should agree.
CLOCK_SECONDS = 60.0
#: A spool of a night without a coordinator, with room to spare.
SPOOL_BYTES = 200_000_000


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What one check found."""

    check: str
    #: "ok", "warning" or "failure": only a failure keeps a worker from working.
    verdict: str
    #: One sentence: what is, and what would be right.
    detail: str


def examine(*, spool: Path, connect: Callable[[], Client]) -> Iterator[Finding]:
    """Yield findings, one per check, as they are made.

    Args:
        spool: where results would wait.
        connect: returns a client of the coordinator; may raise RehybError.
    """
    yield _processor()
    yield _simulation()
    yield _disk(spool)
    yield from _coordinator(connect)


def _processor() -> Finding:
    cores = available_cores()
    found = cpu()
    if found == "unknown":
        return _ok("processor", f"{cores} cores for this process")
    if {"avx", "asimd"} & set(found.split()):
        return _ok("processor", f"{cores} cores for this process, with {found}")
    return Finding(
        check="processor",
        verdict="warning",
        detail=f"{cores} cores without AVX: MuJoCo's own builds ask for it on x86-64",
    )


def _simulation() -> Finding:
    try:
        digest, seconds = canary()
    except RehybError as error:
        return Finding(check="simulation", verdict="failure", detail=str(error))
    detail = f"the nominal elbow took {seconds:.2f} s; code {code()}, canary {digest}"
    if seconds > SLOW_SECONDS:
        return Finding(check="simulation", verdict="warning", detail=f"{detail}: that is slow")
    return _ok("simulation", detail)


def _disk(spool: Path) -> Finding:
    probe = spool / ".doctor"
    try:
        spool.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"x")
        probe.unlink()
        free = shutil.disk_usage(spool).free
    except OSError as error:
        detail = f"results cannot wait in {spool}: {error.strerror}; name another with --spool"
        return Finding(check="spool", verdict="failure", detail=detail)
    detail = f"{free / 1e9:.1f} GB are free for results in {spool}"
    if free < SPOOL_BYTES:
        return Finding(check="spool", verdict="warning", detail=f"only {detail}")
    return _ok("spool", detail)


def _coordinator(connect: Callable[[], Client]) -> Iterator[Finding]:
    try:
        with connect() as client:
            health = client.health()
            yield _ok("coordinator", f"{client.url} answers")
            yield _clock(health.get("date"))
            yield _token(client)
    except RehybError as error:
        yield Finding(check="coordinator", verdict="failure", detail=str(error))


def _clock(date: str | None) -> Finding:
    if date is None:
        return Finding(check="clock", verdict="warning", detail="the coordinator tells no time")
    apart = time.time() - parsedate_to_datetime(date).timestamp()
    detail = f"{abs(apart):.0f} s apart from the coordinator's"
    if abs(apart) > CLOCK_SECONDS:
        detail += ": nothing is lost by that, but its log will not agree with others'"
        return Finding(check="clock", verdict="warning", detail=detail)
    return _ok("clock", detail)


def _token(client: Client) -> Finding:
    try:
        client.workers()
    except Unauthorized as error:
        # A worker's own token need not be good for reading.
        if error.problem.get("status") != 403:
            return Finding(check="token", verdict="failure", detail=str(error))
    return _ok("token", "the coordinator knows it")


def _ok(check: str, detail: str) -> Finding:
    return Finding(check=check, verdict="ok", detail=detail)
