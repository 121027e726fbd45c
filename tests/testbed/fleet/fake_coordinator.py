"""A worker with a coordinator that is none, and children that take no time."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import httpx2

from models.running.pool import Finished
from rehyb.client import Client
from tests.testbed.transport import CoordinatorTransport
from worker.agent import Agent
from worker.leases import Leases
from worker.renewing import Renewals
from worker.spool import Spool


class Coordinator:
    """As much of a coordinator as a worker can see, on the other end of a mock transport."""

    def __init__(self, batches: list[list[str]]) -> None:
        self.batches = batches
        self.ttl = 60.0
        self.calls: list[str] = []
        self.results: dict[str, dict[str, Any]] = {}
        self.renewals: list[str] = []
        self.released: list[str] = []
        self.away = 0
        self.refuse_renewals = False
        self.unusable: set[str] = set()
        self.refused: set[str] = set()
        self.poison: set[str] = set()
        self.sick = 0
        self.status: int | None = None
        self.misfits = 0
        self.sizes: list[int] = []
        #: Knows nothing of requests for work that come with results.
        self.old = False
        #: Everything gets through but results.
        self.clogged = False

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        self.calls.append(path)
        if self.away or (self.clogged and path == "/v1/results"):
            self.away -= self.away > 0
            raise httpx2.ConnectError("connection refused")
        if self.status:
            return httpx2.Response(self.status, json={"title": "no", "detail": "not this token"})
        body = json.loads(request.content)
        if path == "/v1/leases":
            return self._lease(body)
        if path.endswith("/renew"):
            self.renewals.append(path.split("/")[-2])
            if self.refuse_renewals:
                return httpx2.Response(409, json={"detail": "expired"})
            return httpx2.Response(200, json={"ttl_seconds": self.ttl})
        if path.endswith("/release"):
            self.released.append(path.split("/")[-2])
            return httpx2.Response(200, json={})
        return self._results(body)

    def _lease(self, body: Mapping[str, Any]) -> httpx2.Response:
        if misfit := self._misfit():
            return httpx2.Response(409, json={"detail": misfit})
        if granted := self._grant(body):
            return httpx2.Response(201, json=granted)
        return httpx2.Response(204, headers={"Retry-After": "0"})

    def _misfit(self) -> str | None:
        if not self.misfits:
            return None
        self.misfits -= 1
        return "this study was begun with MuJoCo 3"

    def _grant(self, body: Mapping[str, Any]) -> dict[str, Any] | None:
        self.sizes.append(body["max_instances"])
        if not self.batches:
            return None
        instances = [
            {"id": name, "model": "ishigami", "parameters": {"x1": 0.0}}
            for name in self.batches.pop(0)
        ]
        lease = f"lease-of-{instances[0]['id']}"
        return {"id": lease, "fence": 7, "ttl_seconds": self.ttl, "instances": instances}

    def _results(self, body: Mapping[str, Any]) -> httpx2.Response:
        names = [result["instance"] for result in body["results"]]
        if self.sick or self.poison & set(names):
            self.sick -= self.sick > 0
            return httpx2.Response(500, json={"status": 500, "detail": "its log says why"})
        if self.unusable & set(names) or (self.old and "next" in body):
            return httpx2.Response(422, json={"detail": "one of them is malformed"})
        verdicts = []
        for result in body["results"]:
            verdict = "conflict" if result["instance"] in self.refused else "accepted"
            verdicts.append({"instance": result["instance"], "verdict": verdict, "detail": ""})
            if verdict == "accepted":
                self.results[result["instance"]] = {**result, "lease": body["lease"]}
        answer: dict[str, Any] = {"verdicts": verdicts}
        if "next" in body:
            answer["misfit"] = self._misfit()
            answer["next"] = None if answer["misfit"] else self._grant(body["next"])
        return httpx2.Response(
            409 if self.refused else 200, json=answer, headers={"Retry-After": "0"}
        )


class InstantPool:
    """A pool whose instances finish when they are looked at, unless told to take for ever."""

    def __init__(self, processes: int) -> None:
        self.processes = processes
        self.endless: set[str] = set()
        self.started: list[str] = []
        self.killed = False
        self._busy: list[tuple[Mapping[str, Any], Any]] = []

    @property
    def free(self) -> int:
        return self.processes - len(self._busy)

    @property
    def running(self) -> int:
        return len(self._busy)

    def start_bundle(self, bundle: Sequence[tuple[Mapping[str, Any], Any]]) -> None:
        self.started += [instance["id"] for instance, _ in bundle]
        self._busy += bundle

    def wait(self, seconds: float) -> list[Finished]:
        time.sleep(0.001)
        done = [(i, t) for i, t in self._busy if i["id"] not in self.endless]
        self._busy = [(i, t) for i, t in self._busy if i["id"] in self.endless]
        return [
            Finished(
                ticket=t,
                result={
                    "instance": i["id"],
                    "outcome": "ok",
                    "outputs": {"y": 0.5},
                    "wall_seconds": 0.001,
                },
            )
            for i, t in done
        ]

    def kill(self) -> None:
        self.killed = True
        self._busy.clear()


class Work:
    """A worker with its coordinator, its pool and its spool folder."""

    def __init__(
        self,
        folder: Path,
        batches: list[list[str]],
        processes: int = 1,
        max_idle: float | None = 0.05,
    ) -> None:
        self.coordinator = Coordinator(batches)
        self.pool = InstantPool(processes)
        self.folder = folder
        self.max_idle = max_idle
        self.agent = self.new_agent()

    def new_agent(
        self, name: str = "w1", max_instances: int | None = None, client: Client | None = None
    ) -> Agent:
        if client is None:
            client = Client("http://c", "t", transport=CoordinatorTransport(self.coordinator))
        leases = Leases(
            client=client,
            worker={"id": name, "host": "h", "versions": {}},
            models=lambda _: {"ishigami": ""},
            processes=self.pool.processes,
            batch=10,
            left=max_instances,
            rng=Random(1),
        )
        return Agent(
            leases=leases,
            renewals=Renewals(
                renew=partial(leases.renew, client), patience=leases.patience, rng=Random(1)
            ),
            pool=self.pool,  # type: ignore[arg-type]
            spool=Spool(self.folder, name),
            max_idle=self.max_idle,
            rng=Random(1),
        )

    def run_until(self, agent: Agent, done: Callable[[], bool]) -> None:
        """Run a worker that leaves when `done`, however long it has to wait meanwhile."""
        finish = self.pool.wait

        def look(seconds: float) -> list[Finished]:
            if done():
                agent.stop()
            return finish(seconds)

        self.pool.wait = look  # type: ignore[method-assign]
        agent.run()
        self.pool.wait = finish  # type: ignore[method-assign]

    def spooled(self) -> int:
        return len(list(self.folder.glob("*.spool")))
