"""Everything goes wrong at once, and the indices do not show it. `make soak` takes longer over it.

A machine that computes wrong numbers under a lease of its own is not among the faults: only a
second opinion could tell.
"""

import csv
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx2
import pytest
from bad_network import BadNetwork
from test_nothing_is_lost import computed_in_one_go

from rehyb import Client, RehybError, Unreachable
from rehyb.client import Json
from server.store import check, create_engine

TOKEN = "token-of-the-chaos"
#: 1 in `make test`; more in `make soak`.
ROUNDS = int(os.environ.get("REHYB_SOAK_ROUNDS", "1"))
STUDY: Json = {"name": "chaos", "model": "ishigami", "method": "saltelli", "rows": 300, "seed": 5}
LEASE_SECONDS = 2.0
SECONDS = 150.0
#: Processes struck per round: after these, the study is left to end.
BLOWS = 8 if ROUNDS == 1 else 60
KINDS = ("kill worker", "stop worker", "kill coordinator", "kill analysis")


class Lab:
    """A coordinator, an analysis and workers, each restarted when it dies."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.database = f"sqlite:///{folder}/lab.sqlite3"
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self.network = BadNetwork(port, seed)
        self.environment = os.environ | {
            "REHYB_TOKEN": TOKEN,
            "REHYB_URL": self.network.url,
            "REHYB_PORT": str(port),
            "REHYB_DATABASE_URL": self.database,
            "REHYB_LEASE_SECONDS": str(LEASE_SECONDS),
        }
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.commands: dict[str, list[str]] = {}
        self.add("coordinator", "-m", "rehyb", "coordinator")
        log = folder / "coordinator.log"
        self.until(lambda: re.search("^listening on ", log.read_text(), re.M))
        self.add("analysis", "-m", "rehyb", "analysis")

    def add(self, name: str, *command: str) -> None:
        self.commands[name] = [sys.executable, *command]
        self.revive()

    def add_worker(self, name: str, *options: str) -> None:
        spool = str(self.folder / "spool")
        script = str(Path(__file__).with_name("saboteur.py"))
        limits = ["--processes", "1", "--instance-seconds", "1", "--spool", spool]
        self.add(name, script, *limits, *options)

    def revive(self) -> None:
        for name, command in self.commands.items():
            process = self.processes.get(name)
            if process is None or process.poll() is not None:
                with (self.folder / f"{name}.log").open("ab") as log:
                    self.processes[name] = subprocess.Popen(
                        command,
                        env=self.environment,
                        stdout=log,
                        stderr=log,
                        start_new_session=True,
                    )

    def signal(self, name: str, number: signal.Signals) -> None:
        self.processes[name].send_signal(number)

    def close(self) -> None:
        self.network.close()
        for process in self.processes.values():
            process.kill()
            process.wait()

    @staticmethod
    def until(ask: Callable[[], object], seconds: float = 30.0) -> None:
        deadline = time.monotonic() + seconds
        while not ask():
            assert time.monotonic() < deadline, f"still not so after {seconds} s"
            time.sleep(0.05)


@pytest.fixture
def lab(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Lab]:
    lab = Lab(tmp_path, seed=getattr(request, "param", 1))
    yield lab
    lab.close()


def annoy(lab: Lab, study: str, stop: threading.Event, faults: Counter[str]) -> None:
    """Post what nobody should: forged fences, other people's instances, nonsense, floods."""
    rng = random.Random(9)
    evil = {"id": "evil", "host": "elsewhere", "versions": {}}
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
    with httpx2.Client(base_url=lab.url, headers=headers, trust_env=False, timeout=20) as http:
        while not stop.wait(0.1):
            place = f"{study}:{rng.randrange(300)}:{rng.randrange(5)}"
            lie = {"instance": place, "outcome": "ok", "outputs": {"y": rng.random()}}
            post: Json = {"lease": "x" * 32, "fence": 1, "worker": "evil", "results": [lie]}
            with suppress(httpx2.TransportError):
                asked = {"worker": evil, "models": ["ishigami"], "max_instances": 1}
                answer = http.post("/v1/leases", json=asked)
                assert answer.status_code in (204, 409), "evil runs another version"
                kind = rng.choice(["unknown lease", "guessed fence", "garbage", "flood"])
                faults[f"adversary: {kind}"] += 1
                if kind == "guessed fence":
                    post["fence"] = rng.randrange(10_000)
                if kind == "garbage":
                    refused = http.post("/v1/results", content=rng.randbytes(2000))
                elif kind == "flood":
                    refused = http.post("/v1/results", content=b" " * 9_000_000)
                else:
                    refused = http.post("/v1/results", json=post)
                assert 400 <= refused.status_code < 500, refused.status_code


def torment(lab: Lab, blow: str, rng: random.Random, faults: Counter[str]) -> None:
    """Do one thing to one process that no process should suffer."""
    worker = rng.choice([name for name in lab.commands if name.startswith("worker")])
    faults[blow] += 1
    if blow == "kill worker":
        lab.signal(worker, signal.SIGKILL)
    elif blow == "stop worker":
        lab.signal(worker, signal.SIGSTOP)
        time.sleep(LEASE_SECONDS * 1.5)
        lab.signal(worker, signal.SIGCONT)
    else:
        lab.signal(blow.split()[1], signal.SIGKILL)
    time.sleep(0.3)
    lab.revive()


@pytest.mark.parametrize("lab", range(1, ROUNDS + 1), indirect=True, ids=lambda n: f"round-{n}")
def test_whatever_goes_wrong_every_instance_counts_once_and_the_bits_are_the_same(
    lab: Lab, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(int(request.node.callspec.params["lab"]))
    faults: Counter[str] = Counter()
    stop = threading.Event()
    with Client(lab.url, TOKEN) as client:
        study = client.submit(STUDY)
        for number in (1, 2, 3):
            lab.add_worker(f"worker-{number}")
        lab.until(lambda: client.progress(study["id"])["ok"] > 0, 60.0)
        nuisance = threading.Thread(target=annoy, args=(lab, study["id"], stop, faults))
        nuisance.start()
        deadline = time.monotonic() + SECONDS
        done: Json = {}
        try:
            while time.monotonic() < deadline:
                with suppress(Unreachable):
                    done = client.indices(study["id"])
                    if done["rows_complete"] == STUDY["rows"]:
                        break
                    left = client.progress(study["id"])["pending"]
                    struck = sum(faults[kind] for kind in KINDS)
                    if left > 50 and struck < BLOWS:
                        # Each kind first once, then any.
                        blow = KINDS[struck] if struck < len(KINDS) else rng.choice(KINDS)
                        torment(lab, blow, rng, faults)
                lab.revive()
                time.sleep(0.3)
        finally:
            stop.set()
            nuisance.join()
        progress = client.progress(study["id"])
        client.results_csv(study["id"], lab.folder / "results.csv")
    with (lab.folder / "results.csv").open() as file:
        places = Counter((int(line["row"]), int(line["position"])) for line in csv.DictReader(file))
    engine = create_engine(lab.database)
    contradictions = check.faults(engine)
    engine.dispose()
    injected = faults + Counter({f"network: {k}": n for k, n in lab.network.faults.items()})
    injected["instances crashed or hung"] = crashes(lab)
    lost = study["instances"] - progress["ok"]
    with capsys.disabled():
        print(f"\n{sum(injected.values())} faults injected: {dict(sorted(injected.items()))}")
        print(f"{lost} instances lost")
    assert {*KINDS, "instances crashed or hung"} <= set(+injected)
    assert lab.network.faults
    assert lost == 0
    assert (progress["state"], progress["failed"]) == ("complete", 0)
    assert (set(places.values()), len(places)) == ({1}, study["instances"])
    assert contradictions == []
    assert done == computed_in_one_go(study)


def crashes(lab: Lab) -> int:
    """Return how many attempts the coordinator has counted as crashed or timed out."""
    from server.store.engine import reading
    from server.store.schema import instances

    engine = create_engine(lab.database)
    with reading(engine) as connection:
        attempts = [row.attempts for row in connection.execute(instances.select())]
    engine.dispose()
    return sum(a.get("crashed", 0) + a.get("timed_out", 0) for a in attempts)


def test_a_coordinator_killed_under_fifty_workers_loses_nothing_it_acknowledged(lab: Lab) -> None:
    with Client(lab.url, TOKEN) as client:
        study = client.submit({**STUDY, "rows": 100_000})["id"]
    acknowledged: set[str] = set()
    stop = threading.Event()

    def work(name: str) -> None:
        who = {"id": name, "host": name, "versions": {}}
        with Client(lab.url, TOKEN, timeout=5.0) as client:
            while not stop.is_set():
                with suppress(RehybError):
                    lease = client.lease(worker=who, models=["ishigami"], max_instances=5)
                    if lease is None:
                        continue
                    results: list[Any] = [
                        {"instance": i["id"], "outcome": "ok", "outputs": {"y": 1.0}}
                        for i in lease["instances"]
                    ]
                    verdicts = client.post_results(
                        lease=lease["id"], fence=lease["fence"], worker=name, results=results
                    )
                    good = {v["instance"] for v in verdicts if v["verdict"] == "accepted"}
                    acknowledged.update(good)
                    continue
                time.sleep(0.05)

    threads = [threading.Thread(target=work, args=(f"w{n}",)) for n in range(50)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(2 if ROUNDS == 1 else 20):
            before = len(acknowledged)
            lab.until(lambda before=before: len(acknowledged) > before + 100, 60.0)
            lab.signal("coordinator", signal.SIGKILL)
            lab.processes["coordinator"].wait()
            lab.revive()
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    with Client(lab.url, TOKEN) as client:
        lab.until(lambda: answers(client), 30.0)
        client.results_csv(study, lab.folder / "results.csv")
    with (lab.folder / "results.csv").open() as file:
        kept = {f"{study}:{line['row']}:{line['position']}" for line in csv.DictReader(file)}
    assert acknowledged - kept == set()
    engine = create_engine(lab.database)
    assert check.faults(engine) == []
    engine.dispose()


def answers(client: Client) -> bool:
    with suppress(Unreachable):
        return bool(client.health())
    return False
