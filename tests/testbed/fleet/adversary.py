"""Somebody who knows every lease and every token, and posts what nobody should."""

import random
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import httpx2
import sqlalchemy as sa
from sqlalchemy.engine import Engine
from sqlalchemy.exc import SQLAlchemyError

from server.store import create_engine
from server.store.database.engine import reading
from server.store.database.schema import leases, results, workers

FLOOD = 100_000_000
Json = dict[str, Any]


class Adversary:
    """Annoys a coordinator from a thread of its own, for as long as the `with` block lasts.

    Args:
        url: the coordinator.
        token: a good one.
        database: its database, which tells the adversary what nobody could guess.
        study: which study.
    """

    def __init__(self, url: str, token: str, database: str, study: Json) -> None:
        self.faults: Counter[str] = Counter()
        #: Answers that no attack should get.
        self.wrong: list[str] = []
        self._study = study
        self._rng = random.Random(9)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._annoy, args=(url, token, database))
        self._attacks: dict[str, Callable[[httpx2.Client, Engine], httpx2.Response | None]] = {
            "unknown lease": self._unknown_lease,
            "wrong fence": self._wrong_fence,
            "other people's lease": self._other_peoples_lease,
            "other people's results": self._other_peoples_results,
            "foreign instances": self._foreign_instances,
            "garbage": self._garbage,
            "100 MB": self._flood,
            "100 MB unannounced": self._flood_unannounced,
        }

    def __enter__(self) -> "Adversary":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _annoy(self, url: str, token: str, database: str) -> None:
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        engine = create_engine(database)
        with httpx2.Client(base_url=url, headers=headers, trust_env=False, timeout=20) as http:
            while not self._stop.wait(0.2):
                kind = self._rng.choice(list(self._attacks))
                try:
                    answer = self._attacks[kind](http, engine)
                except (httpx2.TransportError, SQLAlchemyError):
                    # The coordinator is away, or has hung up in the midst of a flood.
                    self.faults[kind] += "MB" in kind
                    continue
                if answer is not None:
                    self.faults[kind] += 1
                    # While the database's disk is full.
                    away = answer.status_code == 503 and "Retry-After" in answer.headers
                    if not (400 <= answer.status_code < 500 or away):
                        self.wrong.append(f"{kind}: {answer.status_code} {answer.text}")
        engine.dispose()

    def _lie(self, row: int, position: int, **proof: Any) -> Json:
        place = f"{self._study['id']}:{row}:{position}"
        lie = {"instance": place, "outcome": "ok", "outputs": {"y": self._rng.random()}}
        return {"lease": "x" * 32, "fence": 1, "worker": "evil", "results": [lie], **proof}

    def _anywhere(self) -> tuple[int, int]:
        return self._rng.randrange(self._study["rows"]), self._rng.randrange(5)

    def _lease(self, engine: Engine, *conditions: Any) -> Any:
        """Return a lease that somebody else has or had, as the database knows it; None: none."""
        query = sa.select(leases).where(
            ~leases.c.compares, leases.c.worker_id != "evil", *conditions
        )
        with reading(engine) as connection:
            found = connection.execute(query.order_by(leases.c.fence.desc()).limit(20)).all()
        return self._rng.choice(found) if found else None

    def _unknown_lease(self, http: httpx2.Client, _: Engine) -> httpx2.Response:
        return http.post("/v1/results", json=self._lie(*self._anywhere()))

    def _wrong_fence(self, http: httpx2.Client, engine: Engine) -> httpx2.Response | None:
        lease = self._lease(engine)
        if lease is None:
            return None
        proof = {"lease": lease.id, "fence": lease.fence + 1, "worker": lease.worker_id}
        return http.post("/v1/results", json=self._lie(*lease.instances[0], **proof))

    def _other_peoples_lease(self, http: httpx2.Client, engine: Engine) -> httpx2.Response | None:
        lease = self._lease(engine)
        if lease is None:
            return None
        proof = {"lease": lease.id, "fence": lease.fence}
        return http.post("/v1/results", json=self._lie(*lease.instances[0], **proof))

    def _other_peoples_results(self, http: httpx2.Client, engine: Engine) -> httpx2.Response | None:
        """Change a result that is there, with everything that its worker knows."""
        lease = self._lease(engine, leases.c.state == "finished")
        if lease is None:
            return None
        with reading(engine) as connection:
            query = sa.select(results.c.row, results.c.position)
            there = {tuple(place) for place in connection.execute(query)}
        done = [place for place in lease.instances if tuple(place) in there]
        if not done:
            return None
        proof = {"lease": lease.id, "fence": lease.fence, "worker": lease.worker_id}
        return http.post("/v1/results", json=self._lie(*done[0], **proof))

    def _foreign_instances(self, http: httpx2.Client, engine: Engine) -> httpx2.Response | None:
        """Take a lease, post what it does not hold, and give it back."""
        with reading(engine) as connection:
            versions = connection.scalar(
                sa.select(workers.c.versions).where(workers.c.id != "evil")
            )
        evil = {"id": "evil", "host": "elsewhere", "versions": versions}
        asked = {"worker": evil, "models": [self._study["model"]], "max_instances": 1}
        taken = http.post("/v1/leases", json=asked)
        if taken.status_code != 201:
            return None
        lease = taken.json()
        proof = {"lease": lease["id"], "fence": lease["fence"]}
        held = (lease["instances"][0]["row"], lease["instances"][0]["position"])
        place = self._anywhere()
        answer = None
        if place != held:
            answer = http.post("/v1/results", json=self._lie(*place, **proof))
        http.post(f"/v1/leases/{lease['id']}/release", json={"fence": lease["fence"]})
        return answer

    def _garbage(self, http: httpx2.Client, _: Engine) -> httpx2.Response:
        headers = {"Content-Type": "application/json"}
        return http.post("/v1/results", content=self._rng.randbytes(2000), headers=headers)

    def _flood(self, http: httpx2.Client, _: Engine) -> httpx2.Response:
        headers = {"Content-Length": str(FLOOD)}
        return http.post("/v1/results", content=_spaces(), headers=headers)

    def _flood_unannounced(self, http: httpx2.Client, _: Engine) -> httpx2.Response:
        return http.post("/v1/results", content=_spaces())


def _spaces() -> Iterator[bytes]:
    for _ in range(FLOOD // 1_000_000):
        yield b" " * 1_000_000
