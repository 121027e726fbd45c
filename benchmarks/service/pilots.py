"""Simulated pilots: hosts that talk to a coordinator as `rehyb-worker` does, and only sleep.

When to ask, for how much and when to post is decided by the worker's own code (`worker.leases`) and
its constants. As in a worker, nobody hands the processes anything while a request is under way:
those that finish meanwhile stand idle until the answer is there.
"""

import asyncio
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import Any
from urllib.parse import urlsplit

from pydantic_core import from_json, to_json

from benchmarks.service.coordinator import TOKEN, Json
from rehyb.client import Client
from worker.agent import POST_SECONDS
from worker.leases import Leases, Ticket
from worker.spool import BATCH as POSTED_AT_ONCE

#: The most instances of a lease, as `rehyb-worker --batch` has it.
LARGEST_LEASE = 1000


class Pilot:
    """One host with a connection of its own, without what a client of Python costs.

    Args:
        url: where its coordinator listens.
        client: any, which stands for its own.
        number: of this pilot; every other one is on another host, as second opinions need.
        cores: of the host; so many instances run in it at once.
        seconds_each: how long each of them takes.
    """

    def __init__(
        self, url: str, client: Client, number: int, cores: int, seconds_each: float
    ) -> None:
        self._where = urlsplit(url)
        self._cores, self._seconds_each = cores, seconds_each
        self._leases = Leases(
            client=client,
            worker={"id": f"pilot-{number}", "host": f"host-{number % 2}", "versions": {}},
            models=lambda _: {"ishigami": ""},
            processes=cores,
            batch=LARGEST_LEASE,
            rng=Random(number),
        )
        self._numbers = count()
        #: (when it is done, a number that keeps the order, what it is)
        self._running: list[tuple[float, int, Ticket]] = []
        self._spool: list[Ticket] = []
        self._post_at = 0.0
        #: When each request was answered.
        self.answered: list[float] = []
        #: (when it was answered, seconds that it took) of those that asked for a lease, and
        #: (when it was answered, results) of those that posted.
        self.asked: list[tuple[float, float]] = []
        self.posted: list[tuple[float, int]] = []

    async def run(self, begin: float, end: float) -> None:
        """Work from one moment of the loop's clock to another, and give back what is left."""
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, begin - loop.time()))
        self._reader, self._writer = await asyncio.open_connection(
            self._where.hostname, self._where.port
        )
        while (now := loop.time()) < end:
            self._collect(now)
            await self._talk(now)
            await asyncio.sleep(max(0.0, self._next_talk() - loop.time()))
        left = [ticket for _, _, ticket in self._running] + self._spool + [*self._leases.queue]
        for lease in {ticket.lease.id: ticket.lease for ticket in left}.values():
            await self._ask(f"/v1/leases/{lease.id}/release", {"fence": lease.fence})
        self._writer.close()

    @property
    def _enough(self) -> bool:
        return len(self._leases.queue) >= max(self._cores, self._leases.ahead)

    def _next_talk(self) -> float:
        """Have the processes work until there is something to say; return when that is."""
        while self._running and self._running[0][0] < self._post_at:
            done, _, ticket = heappop(self._running)
            self._finish(ticket)
            self._start(done)
            if not self._enough or self._leases.any_finished:
                return done
        return self._post_at

    def _collect(self, now: float) -> None:
        """Take what was done by now, and have those processes that were idle go on."""
        while self._running and self._running[0][0] <= now:
            self._finish(heappop(self._running)[2])
        self._start(now)

    def _finish(self, ticket: Ticket) -> None:
        self._leases.finish(ticket, self._seconds_each)
        self._spool.append(ticket)

    def _start(self, now: float) -> None:
        while self._leases.queue and len(self._running) < self._cores:
            ticket = self._leases.queue.popleft()
            heappush(self._running, (now + self._seconds_each, next(self._numbers), ticket))

    async def _talk(self, now: float) -> None:
        """Post and ask, as `worker.agent` does."""
        loop = asyncio.get_running_loop()
        request = self._request(now)
        if now >= self._post_at or self._leases.any_finished or (request and self._spool):
            self._post_at = now + POST_SECONDS
            while self._spool:
                await self._post(self._request(loop.time()))
                self._collect(loop.time())
            self._leases.release()
        if request := self._request(loop.time()):
            started = loop.time()
            granted = await self._ask("/v1/leases", dict(request))
            self._take(granted, started)
            self._start(loop.time())

    def _request(self, now: float) -> Any:
        return None if self._enough else self._leases.request(now)

    async def _post(self, request: Any) -> None:
        lease = self._spool[0].lease
        batch = [one for one in self._spool if one.lease is lease][:POSTED_AT_ONCE]
        results = {
            "lease": lease.id,
            "fence": lease.fence,
            "worker": self._leases.worker["id"],
            "results": [self._result(one) for one in batch],
        }
        started = asyncio.get_running_loop().time()
        answer = await self._ask("/v1/results", {**results, "next": request})
        assert answer is not None
        taken = {id(one) for one in batch}
        self._spool = [one for one in self._spool if id(one) not in taken]
        self.posted.append((asyncio.get_running_loop().time(), len(batch)))
        if request is not None:
            self._take(answer["next"], started)

    def _take(self, granted: Json | None, started: float) -> None:
        now = asyncio.get_running_loop().time()
        self._leases.take(granted, None, now)
        self.asked.append((now, now - started))

    def _result(self, ticket: Ticket) -> Json:
        return {
            "instance": ticket.instance["id"],
            "outcome": "ok",
            "outputs": {"y": 1.0},
            "reason": "",
            "state": None,
            "wall_seconds": self._seconds_each,
        }

    async def _ask(self, path: str, body: Json) -> Json | None:
        content = to_json(body)
        head = (
            f"POST {path} HTTP/1.1\r\nHost: c\r\nAuthorization: Bearer {TOKEN}\r\n"
            f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n\r\n"
        )
        self._writer.write(head.encode() + content)
        status = int((await self._reader.readline()).split()[1])
        length = 0
        while (line := await self._reader.readline()) != b"\r\n":
            name, _, value = line.partition(b":")
            if name.lower() == b"content-length":
                length = int(value)
        found = from_json(await self._reader.readexactly(length)) if length else None
        if status >= 400:
            raise RuntimeError(f"{path} answered {status}: {found}")
        self.answered.append(asyncio.get_running_loop().time())
        return found
