"""Batch systems, through the providers of parsl: submit a job, ask how it is, cancel it."""

import inspect
import logging
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any, Protocol

from rehyb.errors import FleetError, Invalid, needs_extra
from rehyb.pilots import commands
from rehyb.pilots.options import objection


class JobState(StrEnum):
    """Where a job is, as far as it matters here."""

    WAITING = "waiting"
    RUNNING = "running"
    ENDED = "ended"
    #: The batch system's list lacks it: it has ended, or the list is not whole.
    MISSING = "missing"


class Engine(Protocol):
    """What starts pilots."""

    def submit(self, command: str, name: str) -> str:
        """Submit one job that runs a line of shell, and return its id; FleetError if refused."""
        ...

    def states(self, jobs: Sequence[str]) -> dict[str, JobState]:
        """Return where jobs are; FleetError says why the batch system does not."""
        ...

    def cancel(self, jobs: Sequence[str]) -> None:
        """Have jobs ended; FleetError if the batch system does not take it."""
        ...


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How one batch system is reached."""

    #: Of `parsl.providers`.
    provider: str
    #: The command that must be there.
    command: str = ""
    #: What the provider calls the cores of a job; empty: only `scheduler_options` can say.
    cores: str = ""
    #: Seconds between two questions: a batch system serves many.
    look_seconds: float = 10.0
    #: What this project wants otherwise than the provider.
    defaults: Mapping[str, Any] = field(default_factory=dict)


#: By the name in a pilots file.
ENGINES = {
    "local": Kind(provider="LocalProvider", look_seconds=1.0),
    "slurm": Kind(
        provider="SlurmProvider",
        command="sbatch",
        cores="cores_per_node",
        defaults={"exclusive": False, "cmd_timeout": 60},
    ),
    "pbs": Kind(provider="PBSProProvider", command="qsub", cores="cpus_per_node"),
    "lsf": Kind(
        provider="LSFProvider",
        command="bsub",
        cores="cores_per_block",
        defaults={"request_by_nodes": False},
    ),
    "condor": Kind(provider="CondorProvider", command="condor_submit", cores="cores_per_slot"),
    "sge": Kind(provider="GridEngineProvider", command="qsub"),
}
_NO_NUMBER = "the batch system gave the job no number"
#: What providers stumble over that take apart what is not there.
_NO_SUCH_ANSWER = (AttributeError, LookupError, TypeError, ValueError)
#: A path that needs no quotes in a shell.
_PLAIN = re.compile(r"[A-Za-z0-9./_+-]+")
#: What follows from other entries of the file, or is decided by `rehyb pilots` itself.
_OURS = {
    "walltime",
    "worker_init",
    "launcher",
    "nodes_per_block",
    "init_blocks",
    "min_blocks",
    "max_blocks",
    "parallelism",
}


class ParslEngine:
    """A batch system behind a provider of parsl.

    Args:
        name: of ENGINES.
        folder: where job scripts and what jobs print are kept; jobs must see it too.
        walltime: seconds after which a job is ended.
        cores: of a job.
        before: lines of shell before the job's own.
        options: what else the provider takes.

    Raises:
        Invalid: the provider does not take an option, the batch system's command is not here, or
            the folder's name needs quotes.
        FleetError: the batch system does not answer.
        RehybError: parsl is not installed.
    """

    def __init__(
        self,
        name: str,
        *,
        folder: Path,
        walltime: float,
        cores: int,
        before: str,
        options: Mapping[str, Any],
    ) -> None:
        kind = ENGINES[name]
        if kind.command and shutil.which(kind.command) is None:
            raise Invalid(
                f"there is no {kind.command} on this machine, which provider = {name!r} needs: "
                "run rehyb pilots where jobs are submitted"
            )
        if not _PLAIN.fullmatch(str(folder)):
            # Providers put it into commands as it is.
            raise Invalid(
                f"{folder} has characters that batch systems stumble over: name a folder of "
                "letters, digits and ./_+- with --directory"
            )
        with needs_extra("rehyb pilots", "pilots"):
            from parsl import providers
            from parsl.jobs.states import JobState as Parsl
            from parsl.jobs.states import JobStatus
            from parsl.providers import cluster_provider
            from parsl.providers.local import local
        # Providers find it there.
        runs: Sequence[Any] = (cluster_provider, local)
        for module in runs:
            module.execute_wait = commands.run
        # What it logs is said here again, in one sentence.
        logging.getLogger("parsl").setLevel(logging.CRITICAL)
        provider: Any = getattr(providers, kind.provider)
        parameters = inspect.signature(provider.__init__).parameters
        known = list(parameters)[1:]
        for option, value in options.items():
            if option not in known or option in _OURS or option == kind.cores:
                free = [one for one in known if one not in _OURS and one != kind.cores]
                raise Invalid(
                    f"[options] of {name} has no {option!r}: it takes {', '.join(sorted(free))}"
                )
            if (wrong := objection(parameters[option], value)) is not None:
                raise Invalid(f"[options] of {name}: {wrong}")
        given = {**kind.defaults, "worker_init": before, **options}
        if "walltime" in known:
            given["walltime"] = _clock(walltime)
        if kind.cores:
            given[kind.cores] = cores
        try:
            self._provider = provider(**given)
        except TimeoutError as error:
            raise FleetError(str(error)) from None
        except Exception as error:
            # Whatever parsl checks, with whatever it checks.
            raise Invalid(f"[options] of {name}: {_in_one_line(error)}") from None
        folder.mkdir(parents=True, exist_ok=True)
        self._provider.script_dir = str(folder)
        #: What the batch system's command printed that ran last.
        self._said = ""
        # That of this machine has none.
        if (execute := getattr(self._provider, "execute_wait", None)) is not None:
            self._provider.execute_wait = partial(self._heard, execute)
        self._states = {
            Parsl.PENDING: JobState.WAITING,
            Parsl.HELD: JobState.WAITING,
            Parsl.RUNNING: JobState.RUNNING,
            # What nobody can name may be there.
            Parsl.UNKNOWN: JobState.WAITING,
            # Providers say so of whatever a list lacks, too.
            Parsl.COMPLETED: JobState.MISSING,
        }
        self._unanswered = partial(JobStatus, Parsl.UNKNOWN)

    def submit(self, command: str, name: str) -> str:
        """Submit one job that runs a line of shell, and return its id; FleetError if refused."""
        try:
            job = self._provider.submit(command, 1, name)
        except Exception as error:
            if getattr(error, "retcode", None) == 0:
                # Whatever else it warned of is not the reason.
                raise FleetError(_NO_NUMBER) from None
            said = str(getattr(error, "stderr", "") or "").strip().splitlines()
            raise FleetError(said[-1] if said else _first_line(error)) from None
        if not job:
            raise FleetError(_NO_NUMBER)
        return str(job)

    def states(self, jobs: Sequence[str]) -> dict[str, JobState]:
        """Return where jobs are; FleetError says why the batch system does not."""
        known = self._provider.resources
        # Providers ask no more for what they hold for ended, though a list may only have lacked it.
        asked = {job: known[job]["status"] for job in jobs if known[job]["status"].terminal}
        unanswered = {job: self._unanswered() for job in asked}
        for job, status in unanswered.items():
            known[job]["status"] = status
        try:
            self._provider.status(list(jobs))
        except _NO_SUCH_ANSWER:
            raise FleetError(
                f"the batch system's answer cannot be read: it begins with {self._said[:60]!r}"
            ) from None
        except Exception as error:
            raise FleetError(f"the batch system does not answer: {_first_line(error)}") from None
        finally:
            for job, status in unanswered.items():
                if known[job]["status"] is status:
                    known[job]["status"] = asked[job]
        return {job: self._states.get(known[job]["status"].state, JobState.ENDED) for job in jobs}

    def cancel(self, jobs: Sequence[str]) -> None:
        """Have jobs ended; FleetError if the batch system does not take it."""
        if not jobs:
            return
        try:
            done = self._provider.cancel(list(jobs))
        except Exception as error:
            raise FleetError(_first_line(error)) from None
        if not all(done):
            raise FleetError(f"jobs {', '.join(jobs)} were not cancelled")

    def _heard(
        self, execute: Callable[..., tuple[int, str, str]], *told: Any
    ) -> tuple[int, str, str]:
        found = execute(*told)
        self._said = found[1]
        return found


def _clock(walltime: float) -> str:
    """Return seconds as HH:MM:SS, of whole minutes: some batch systems know nothing smaller."""
    minutes = ceil(walltime / 60.0)
    return f"{minutes // 60:02}:{minutes % 60:02}:00"


def _in_one_line(error: Exception) -> str:
    """Return all that an error says: the first of several lines may only announce the others."""
    return " ".join(str(error).split()) or type(error).__name__


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
