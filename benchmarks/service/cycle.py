"""Where a coordinator's time goes while a worker posts ten results and leases ten instances.

`python -m benchmarks.service.cycle`. Each part is measured within this process, again and again,
and the quickest blocks count: processor time, which others on the machine lengthen but never
shorten.
"""

import asyncio
import json
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from pydantic import SecretStr

from analysis.designs import DEFAULT_SAMPLING
from benchmarks.machine import describe_machine
from benchmarks.measuring import percentile
from benchmarks.service.coordinator import TOKEN, coordinator, done, submit, throughput
from benchmarks.service.throughput import PROCESSES, ROWS, SECONDS
from server.app import create_app
from server.logic.fleet.verdicts import Report
from server.logic.study.plans import draw_up
from server.logic.study.points import parameters
from server.operations.fleet.exchange import Exchange, Grant, LeaseRequest, Post
from server.operations.fleet.turns import serve_within
from server.operations.study import studies
from server.records import Introduction
from server.settings import Settings
from server.store import upgrade
from server.store.database.engine import ImmediateWriter
from sim.models import ISHIGAMI

BATCH = 10
#: Cycles in a block; blocks.
CYCLES, BLOCKS = 20, 40
#: Of all blocks, those that nobody disturbed.
QUIET_PERCENT = 10
WORKER: dict[str, Any] = {"id": "w", "host": "here", "versions": {}}
WISH = {"worker": WORKER, "models": ["ishigami"], "max_instances": BATCH}

Json = dict[str, Any]


async def quickest(cycle: Callable[[], Awaitable[None]]) -> float:
    """Return the processor time of one cycle in blocks that nobody disturbed, ms."""
    blocks = []
    for _ in range(BLOCKS):
        before = time.process_time()
        for _ in range(CYCLES):
            await cycle()
        blocks.append((time.process_time() - before) / CYCLES * 1e3)
    return percentile(blocks, QUIET_PERCENT)


def application(url: str) -> FastAPI:
    """Return a coordinator with a study, without a network."""
    upgrade(url)
    app = create_app(Settings(database_url=url, token=SecretStr(TOKEN)))
    plan = draw_up(
        name="bench",
        model=ISHIGAMI,
        called=ISHIGAMI.name,
        method="saltelli",
        sampling=DEFAULT_SAMPLING,
        rows=ROWS,
        seed=1,
        factors=None,
        fixed={},
        outputs=None,
    )
    studies.create(app.state.engine, plan, key=None, digest="", now=time.time())
    return app


async def transactions(app: FastAPI) -> float:
    """Return what the transaction of a cycle takes, ms: statements, and what is decided."""
    begin = ImmediateWriter(app.state.engine)
    worker = Introduction(id="w", host="here", versions={})
    request = LeaseRequest(worker=worker, models=["ishigami"], max_instances=BATCH)
    with begin() as connection:
        first = Exchange(request=request, now=time.time(), ttl=60.0)
        held = granted(serve_within(connection, [first]))

    async def cycle() -> None:
        nonlocal held
        reports = [
            Report(
                instance=f"{held.study.id}:{row}:{position}",
                outcome="ok",
                outputs={"y": 1.0},
                reason="",
                state=None,
                wall_seconds=0.0,
            )
            for row, position in held.lease.instances
        ]
        posted = Post(
            reports=reports,
            lease=held.lease.id,
            fence=held.lease.fence,
            worker="w",
            share=0.01,
            tolerance=1e-3,
        )
        with begin() as connection:
            now = time.time()
            both = Exchange(posted=posted, request=request, now=now, ttl=60.0)
            held = granted(serve_within(connection, [both]))

    spent = await quickest(cycle)
    begin.close()
    return spent


def granted(answers: Sequence[tuple[object, object]]) -> Grant:
    """Return the lease of the one who asked."""
    ((_, found),) = answers
    assert isinstance(found, Grant)
    return found


async def points(app: FastAPI) -> float:
    """Return what it takes to make the parameters of ten instances, ms."""
    (study,) = studies.every(app.state.engine)
    row = 0

    async def cycle() -> None:
        nonlocal row
        for _ in range(BATCH // study.plan.width):
            parameters(study.plan, row)
            row += 1

    return await quickest(cycle)


async def requests(app: FastAPI) -> float:
    """Return what a whole request takes, ms, from the bytes of its body to those of its answer."""
    granted = await ask(app, "/v1/leases", WISH)
    answer: Json = {}

    async def cycle() -> None:
        nonlocal granted, answer
        answer = await ask(app, "/v1/results", {**done(WORKER, granted), "next": WISH})
        granted = answer["next"]

    whole = await quickest(cycle)
    text = json.dumps(answer)

    async def asking() -> None:
        """Do what the one who asks does: that is not the coordinator's time."""
        json.dumps({**done(WORKER, granted), "next": WISH}).encode()
        json.loads(text)

    return whole - await quickest(asking)


async def ask(app: FastAPI, path: str, body: Json) -> Json:
    """Return an application's answer to a request that no network brought (ASGI)."""
    content, answer = json.dumps(body).encode(), bytearray()
    headers = [
        (b"authorization", f"Bearer {TOKEN}".encode()),
        (b"content-type", b"application/json"),
    ]
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "POST",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "scheme": "http",
        "server": ("127.0.0.1", 80),
        "client": ("127.0.0.1", 1),
        "headers": headers,
        "state": {},
    }

    async def receive() -> Json:
        return {"type": "http.request", "body": content, "more_body": False}

    async def send(message: Any) -> None:
        answer.extend(message.get("body", b""))

    await app(scope, receive, send)
    found: Json = json.loads(answer)
    return found


async def within(folder: Path) -> tuple[float, float, float]:
    """Return what the transaction, the parameters and the whole request take, ms."""
    found = []
    for number, part in enumerate((transactions, points, requests)):
        app = application(f"sqlite:///{folder}/part-{number}.sqlite3")
        async with app.router.lifespan_context(app):
            found.append(await part(app))
    return found[0], found[1], found[2]


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix="rehyb-bench-") as name:
        transaction, made, request = asyncio.run(within(Path(name)))
        with coordinator(f"sqlite:///{name}/service.sqlite3") as running:
            submit(running.url, ROWS)
            served = throughput(running, processes=PROCESSES, batch=BATCH, seconds=SECONDS)
    whole = served.server_ms * BATCH
    print(
        f"\nA coordinator's processor time for {BATCH} results and the next {BATCH} instances, ms"
    )
    for what, spent in (
        ("the transaction, on SQLite", transaction),
        ("the parameters of the next instances", made),
        (
            "reading the request, finding its route, wording the answer",
            request - transaction - made,
        ),
        (f"sockets, threads and what {PROCESSES} workers at once cost", whole - request),
        ("in all", whole),
    ):
        print(f"  {what:52s} {spent:6.2f}")
    print(f"  one core would do {BATCH / whole * 1e3:.0f} instances per second")


if __name__ == "__main__":
    main()
