"""A keeper of pilots with a batch system and a coordinator that a test makes up."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx2

from rehyb.client import Client
from rehyb.errors import FleetError
from rehyb.pilots.engines import JobState
from rehyb.pilots.job import TICKETS
from rehyb.pilots.keeper import Keeper
from rehyb.pilots.settings import checked
from tests.testbed.transport import CoordinatorTransport

WAITING, RUNNING, ENDED = JobState.WAITING, JobState.RUNNING, JobState.ENDED
FILE = {"provider": "local", "walltime": "1h", "cores": 4, "maximum": 3}


class Batch:
    """A batch system that does as it is told."""

    def __init__(self) -> None:
        self.jobs: dict[str, JobState] = {}
        self.commands: list[str] = []
        self.refuses = ""
        self.cancels = 0

    def submit(self, command: str, name: str) -> str:
        if self.refuses:
            self.commands.append(command)
            raise FleetError(self.refuses)
        job = str(len(self.commands))
        self.commands.append(command)
        self.jobs[job] = WAITING
        return job

    def states(self, jobs: Sequence[str]) -> dict[str, JobState]:
        return {job: self.jobs[job] for job in jobs}

    def cancel(self, jobs: Sequence[str]) -> None:
        self.cancels += bool(jobs)
        if self.refuses and jobs:
            raise FleetError(self.refuses)
        self.jobs |= dict.fromkeys(jobs, ENDED)


class Site:
    """A keeper with a batch system and a coordinator that has so much work."""

    def __init__(self, folder: Path, **said: Any) -> None:
        self.work: dict[str, Any] = {"waiting": 0, "under_way": 0}
        self.groups: set[str] = set()
        self.batch = Batch()
        self.keeper = Keeper(
            settings=checked({**FILE, **said}),
            engine=self.batch,
            client=Client("http://c", "t", transport=CoordinatorTransport(self.answer)),
            token="t",
            folder=folder,
        )
        self.keeper.prepare()

    def answer(self, request: httpx2.Request) -> httpx2.Response:
        if not self.work:
            raise httpx2.ConnectError("connection refused")
        self.groups.add(request.url.params["group"])
        return httpx2.Response(200, json=self.work)

    def tickets(self) -> list[str]:
        return sorted(path.name for path in (self.keeper.folder / TICKETS).iterdir())

    def run(self) -> None:
        self.batch.jobs = {j: RUNNING if s == WAITING else s for j, s in self.batch.jobs.items()}


def ticket(command: str) -> str:
    """Return the name of the ticket that a job's command has."""
    return command.split()[2]
