"""What a coordinator has acknowledged is there, however often it is killed."""

import csv
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from rehyb import Client, RehybError, Unreachable
from server.operations import check
from server.store import create_engine
from tests.testbed.fleet import warm

TOKEN = "token-of-those-who-acknowledge"
KILLS = 20
WORKERS = 50
#: Results acknowledged between two kills.
BETWEEN = 100
STUDY = {"name": "kills", "model": "ishigami", "method": "saltelli", "rows": 100_000, "seed": 5}


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path}/rehyb.sqlite3"
    return str(request.getfixturevalue("empty_database")())


class Coordinator:
    """A coordinator's process, which is back at once when it was killed."""

    def __init__(self, database: str, log: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self._log = log
        self._environment = os.environ | {
            "REHYB_DATABASE_URL": database,
            "REHYB_PORT": str(port),
            "REHYB_TOKEN": TOKEN,
            "REHYB_LEASE_SECONDS": "2",
        }
        self._process = self.start()

    def start(self) -> warm.Process:
        return warm.Process("rehyb", "coordinator", environment=self._environment, out=self._log)

    def kill(self) -> None:
        """SIGKILL, and start again."""
        self.end()
        self._process = self.start()

    def end(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def coordinator(database: str, tmp_path: Path) -> Iterator[Coordinator]:
    coordinator = Coordinator(database, tmp_path / "log")
    yield coordinator
    coordinator.end()


def until(ask: Callable[[], object], seconds: float = 200.0) -> None:
    """Wait until the answer is true."""
    deadline = time.monotonic() + seconds
    while not ask():
        assert time.monotonic() < deadline, f"still not so after {seconds} s"
        time.sleep(0.02)


def answers(client: Client) -> bool:
    with suppress(Unreachable):
        return bool(client.health())
    return False


def work(url: str, name: str, acknowledged: set[str], stop: threading.Event) -> None:
    """Post and lease until told to stop; note what was acknowledged."""
    who = {"id": name, "host": name, "versions": {}}
    request = {"worker": who, "models": ["ishigami"], "max_instances": 5}
    lease = None
    with Client(url, TOKEN, timeout=5.0) as client:
        while not stop.is_set():
            try:
                lease = lease or client.lease(**request)  # type: ignore[arg-type]
                if lease is None:
                    continue
                results: list[Any] = [
                    {"instance": instance["id"], "outcome": "ok", "outputs": {"y": 1.0}}
                    for instance in lease["instances"]
                ]
                answer = client.exchange(
                    lease=lease["id"],
                    fence=lease["fence"],
                    worker=name,
                    results=results,
                    request=request,
                )
            except RehybError:
                lease = None
                stop.wait(0.02)
                continue
            acknowledged.update(
                v["instance"] for v in answer["verdicts"] if v["verdict"] == "accepted"
            )
            lease = answer["next"]


def test_a_coordinator_killed_twenty_times_under_fifty_workers_loses_nothing_it_acknowledged(
    coordinator: Coordinator, database: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    acknowledged: set[str] = set()
    stop = threading.Event()
    with Client(coordinator.url, TOKEN) as client:
        until(lambda: answers(client))
        study = client.submit(STUDY)["id"]
        threads = [
            threading.Thread(target=work, args=(coordinator.url, f"w{n}", acknowledged, stop))
            for n in range(WORKERS)
        ]
        for thread in threads:
            thread.start()
        try:
            for _ in range(KILLS):
                before = len(acknowledged)
                until(lambda before=before: len(acknowledged) >= before + BETWEEN)
                coordinator.kill()
        finally:
            stop.set()
            for thread in threads:
                thread.join()
        until(lambda: answers(client))
        client.results_csv(study, tmp_path / "results.csv")
    with (tmp_path / "results.csv").open() as file:
        kept = {f"{study}:{line['row']}:{line['position']}" for line in csv.DictReader(file)}
    missing = acknowledged - kept
    with capsys.disabled():
        print(
            f"\n{database.split(':')[0]}: {KILLS} kills under {WORKERS} workers, "
            f"{len(acknowledged)} results acknowledged, {len(missing)} of them missing"
        )
    assert missing == set()
    engine = create_engine(database)
    assert check.faults(engine) == []
    engine.dispose()
