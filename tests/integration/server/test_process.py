"""A coordinator as a process: real sockets, real signals, many clients at once."""

import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from rehyb import Client, Unreachable
from rehyb.client.wire import SPEAKER
from server.http.connections import STRANGERS_PER_ADDRESS
from tests.testbed.coordinators.certificates import self_signed
from tests.testbed.fleet import warm
from tests.testbed.fleet.lab import until

TOKEN = "only-for-this-test"
STUDY = {"name": "s", "model": "ishigami", "method": "saltelli", "rows": 40}
STARTED = re.compile(r"listening on (https?://127\.0\.0\.\d:\d+)\n")

Start = Callable[..., "Coordinator"]


class Coordinator:
    """A process that runs `rehyb coordinator`."""

    def __init__(self, database: Path, number: int, **settings: str) -> None:
        environment = {
            **os.environ,
            "REHYB_DATABASE_URL": f"sqlite:///{database}",
            "REHYB_TOKEN": TOKEN,
            "REHYB_HOST": "127.0.0.1",
            "REHYB_PORT": "0",
            **settings,
        }
        self._out, self._err = (database.with_name(f"{number}.{kind}") for kind in ("out", "err"))
        self._out.touch()
        self.process = warm.Process(
            "rehyb", "coordinator", environment=environment, out=self._out, err=self._err
        )
        # The line may be there before its end is.
        until(lambda: "\n" in self._out.read_text() or self.process.poll() is not None)
        said = self._out.read_text()
        match = STARTED.fullmatch(said)
        assert match is not None, (said, self.process.poll(), self._err.read_text())
        self.url = match[1]

    def client(self, token: str = TOKEN) -> httpx2.Client:
        headers = {"Authorization": f"Bearer {token}"}
        return httpx2.Client(base_url=self.url, headers=headers, trust_env=False, timeout=30.0)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str, str]:
        """Send a signal; returns the exit code and what else was written."""
        self.process.send_signal(number)
        code = self.process.wait(20)
        return code, STARTED.sub("", self._out.read_text()), self._err.read_text()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start coordinators on one database; those still running are killed in the end."""
    started: list[Coordinator] = []

    def run(**settings: str) -> Coordinator:
        started.append(Coordinator(tmp_path / "rehyb.sqlite3", len(started), **settings))
        return started[-1]

    yield run
    for coordinator in started:
        coordinator.process.kill()
        coordinator.process.wait()


def _asking(worker: str, n: int) -> dict[str, Any]:
    who = {"id": worker, "host": "h", "versions": {}}
    return {"worker": who, "models": ["ishigami"], "max_instances": n}


def _answering(lease: dict[str, Any], worker: str, **changes: Any) -> dict[str, Any]:
    results = [
        {"instance": i["id"], "outcome": "ok", "outputs": {"y": i["parameters"]["x1"]}}
        for i in lease["instances"]
    ]
    proof = {"lease": lease["id"], "fence": lease["fence"], "worker": worker}
    return {**proof, "results": results, **changes}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_announces_itself_serves_and_stops_cleanly_on_a_signal(
    start: Start, number: signal.Signals
) -> None:
    coordinator = start()
    with coordinator.client("wrong") as stranger:
        assert stranger.get("/healthz").status_code == 200
        assert stranger.get("/readyz").status_code == 200
        assert stranger.get("/v1/studies").status_code == 401
    with coordinator.client() as client:
        assert client.get("/v1/studies").json() == {"studies": [], "next": None}
    assert coordinator.stop(number) == (0, "", "")


def test_a_second_ctrl_c_leaves_no_traceback_either(start: Start) -> None:
    coordinator = start()
    coordinator.process.send_signal(signal.SIGINT)
    # It takes 0.1 s at least to stop.
    time.sleep(0.05)
    _, *written = coordinator.stop(signal.SIGINT)
    assert written == ["", ""]


def test_without_a_token_it_says_so_in_a_sentence_and_does_not_start(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("REHYB_")}
    ended = subprocess.run(
        [sys.executable, "-m", "rehyb", "coordinator"],
        env={**environment, "REHYB_DATABASE_URL": f"sqlite:///{tmp_path / 'x'}"},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith("rehyb: REHYB_TOKEN: ")
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_restart_keeps_studies_results_and_leases(start: Start, number: signal.Signals) -> None:
    first = start()
    with first.client() as client:
        study = client.post("/v1/studies", json=STUDY).json()
        done = client.post("/v1/leases", json=_asking("w", 5)).json()
        assert client.post("/v1/results", json=_answering(done, "w")).status_code == 200
        held = client.post("/v1/leases", json=_asking("w", 5)).json()
    first.stop(number)
    with start().client() as client:
        assert client.get(f"/v1/studies/{study['id']}").json() == study
        proof = {"fence": held["fence"]}
        assert client.post(f"/v1/leases/{held['id']}/renew", json=proof).status_code == 200
        assert client.post("/v1/results", json=_answering(held, "w")).status_code == 200
        progress = client.get(f"/v1/studies/{study['id']}/progress").json()
        assert (progress["ok"], progress["leased"], progress["rows_complete"]) == (10, 0, 2)


def test_many_workers_at_once_never_share_an_instance_and_finish_the_study(start: Start) -> None:
    coordinator = start()
    with coordinator.client() as client:
        study = client.post("/v1/studies", json=STUDY).json()
    taken: list[str] = []
    refused: list[Any] = []

    def work(worker: str) -> None:
        with coordinator.client() as client:
            while True:
                response = client.post("/v1/leases", json=_asking(worker, 7))
                if response.status_code == 204:
                    return
                lease = response.json()
                taken.extend(instance["id"] for instance in lease["instances"])
                answer = client.post("/v1/results", json=_answering(lease, worker))
                if answer.status_code != 200:
                    refused.append(answer.json())

    threads = [threading.Thread(target=work, args=(f"w{i}",)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert refused == []
    assert len(taken) == len(set(taken)) == study["instances"] == 200
    with coordinator.client() as client:
        progress = client.get(f"/v1/studies/{study['id']}/progress").json()
        workers = client.get("/v1/workers").json()["workers"]
        table = client.get(f"/v1/studies/{study['id']}/results.csv").text
    assert (progress["state"], progress["ok"], progress["rows_complete"]) == ("complete", 200, 40)
    assert sum(worker["instances_done"] for worker in workers) == 200
    assert len(table.splitlines()) == 201


def test_a_silent_worker_s_instances_come_back_without_anybody_asking(start: Start) -> None:
    with start(REHYB_LEASE_SECONDS="0.4").client() as client:
        study = client.post("/v1/studies", json=STUDY).json()
        client.post("/v1/leases", json=_asking("w", 5))
        deadline = time.monotonic() + 10.0
        leased = 5
        while leased and time.monotonic() < deadline:
            time.sleep(0.05)
            leased = client.get(f"/v1/studies/{study['id']}/progress").json()["leased"]
        assert leased == 0


def test_whatever_a_hostile_worker_posts_nothing_gets_in_and_the_coordinator_lives(
    start: Start,
) -> None:
    coordinator = start()
    with coordinator.client() as client:
        study = client.post("/v1/studies", json=STUDY).json()
        mine = client.post("/v1/leases", json=_asking("me", 5)).json()
        theirs = client.post("/v1/leases", json=_asking("they", 5)).json()
        good = _answering(mine, "me")
        first = good["results"][0]
        attacks: list[dict[str, Any]] = [
            {"fence": mine["fence"] + 1},
            {"fence": theirs["fence"]},
            {"worker": "they"},
            {"lease": theirs["id"], "fence": theirs["fence"]},
            {"lease": "../../etc/passwd"},
            {"results": _answering(theirs, "they")["results"]},
            {"results": [{**first, "instance": f"{study['id']}:39:4"}]},
            {"results": [{**first, "instance": "'; DROP TABLE results; --"}]},
            {"results": [{**first, "outputs": {"y": "1.0"}}]},
            {"results": [{**first, "outputs": {"y": 10**400}}]},
            {"results": [{**first, "outputs": {}}]},
            {"results": [{**first, "outputs": []}]},
            {"results": [{**first, "outcome": "lost"}]},
            {"results": [{**first, "admin": True}]},
            {"results": [first] * 1001},
        ]
        for attack in attacks:
            response = client.post("/v1/results", json={**good, **attack})
            assert response.status_code in (409, 422), attack
        for body in [
            b"",
            b"\xff\xfe",
            b"[" * 50_000,
            b'{"lease": NaN}',
            b'"\\ud800"',
            b"0" * 9_000,
        ]:
            response = client.post(
                "/v1/results", content=body, headers={"Content-Type": "application/json"}
            )
            assert response.status_code in (400, 415, 422), body[:20]
        too_large = client.post("/v1/results", content=b"0" * (9 * 1024 * 1024))
        assert too_large.status_code == 413
        # Also to a client that hears nothing before it has sent everything.
        with socket.create_connection((client.base_url.host, client.base_url.port or 80)) as plain:
            size = 9 * 1024 * 1024
            head = f"POST /v1/results HTTP/1.1\r\nHost: c\r\nContent-Length: {size}\r\n"
            plain.sendall(
                f"{head}Authorization: {client.headers['Authorization']}\r\n\r\n".encode()
            )
            # And to one that sends nothing before it has heard something.
            plain.settimeout(10)
            answer = b""
            while not answer.endswith(b"}"):
                answer += plain.recv(10_000)
            assert answer.startswith(b"HTTP/1.1 413")
            plain.sendall(b"0" * size)
            plain.sendall(b"GET /healthz HTTP/1.1\r\nHost: c\r\n\r\n")
            assert plain.recv(100).startswith(b"HTTP/1.1 200")
        progress = client.get(f"/v1/studies/{study['id']}/progress").json()
        assert (progress["ok"], progress["failed"], progress["pending"]) == (0, 0, 191)
        verdicts = client.post("/v1/results", json=good).json()["verdicts"]
        assert [v["verdict"] for v in verdicts] == ["accepted"] * 5
    code, _, err = coordinator.stop()
    assert (code, err) == (0, "")


def test_a_coordinator_refuses_a_damaged_file_and_says_where_to_look(
    start: Start, tmp_path: Path
) -> None:
    start().stop()
    with (tmp_path / "rehyb.sqlite3").open("r+b") as pages:
        pages.seek(20 * 4096)
        pages.write(b"\xa5" * 10 * 4096)
    with pytest.raises(AssertionError, match=r"is damaged .*rehyb db check"):
        start()


def test_a_second_coordinator_on_the_same_file_refuses_to_start(
    start: Start, tmp_path: Path
) -> None:
    first = start()
    with pytest.raises(
        AssertionError, match="a coordinator, or a `rehyb db` command, is at work on"
    ):
        start()
    # Nor by another name of it.
    soft, hard = tmp_path / "soft.sqlite3", tmp_path / "hard.sqlite3"
    soft.symlink_to("rehyb.sqlite3")
    hard.hardlink_to(tmp_path / "rehyb.sqlite3")
    for link in (soft, hard):
        with pytest.raises(
            AssertionError, match="a coordinator, or a `rehyb db` command, is at work on"
        ):
            start(REHYB_DATABASE_URL=f"sqlite:///{link}")
    assert first.stop()[0] == 0
    start()


def test_with_a_certificate_it_speaks_tls_to_those_who_trust_it(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An address that is not among those a client takes for itself, for which it asks nobody.
    address = "127.0.0.2"
    certificate, key = self_signed(tmp_path, address)
    coordinator = start(
        REHYB_HOST=address, REHYB_TLS_CERTIFICATE=str(certificate), REHYB_TLS_KEY=str(key)
    )
    assert coordinator.url.startswith("https://")
    with (
        Client(coordinator.url, TOKEN) as client,
        pytest.raises(Unreachable, match=r"(?i)certific"),
    ):
        client.studies()
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    with Client(coordinator.url, TOKEN) as client:
        assert client.studies() == []


def test_every_answer_says_that_it_is_a_coordinators(start: Start) -> None:
    coordinator = start()
    with coordinator.client() as client:
        answers = [
            client.get("/healthz"),
            client.get("/v1/studies"),
            client.get("/v1/studies/none"),
            client.get("/v1/studies", headers={"Authorization": "Bearer wrong"}),
            client.post("/v1/leases", json={}),
        ]
    assert [answer.status_code for answer in answers] == [200, 200, 404, 401, 422]
    assert {answer.headers[SPEAKER] for answer in answers} == {"coordinator"}


def test_half_open_connections_make_room_for_those_with_a_token(start: Start) -> None:
    coordinator = start()
    address = (httpx2.URL(coordinator.url).host, httpx2.URL(coordinator.url).port)
    with coordinator.client() as client:
        assert client.get("/v1/studies").status_code == 200
        flood = [socket.create_connection(address) for _ in range(300)]
        for one in flood:
            one.send(b"POST /v1/leases HTTP/1.1\r\nHost:")
        assert client.get("/v1/studies").status_code == 200
        with coordinator.client() as late:
            assert late.get("/v1/studies").status_code == 200
        gone, _, _ = select.select(flood, [], [], 5.0)
        assert len(gone) >= 300 - STRANGERS_PER_ADDRESS
        assert flood[-1] not in gone
    for one in flood:
        one.close()


def test_a_listener_does_not_keep_a_coordinator_from_stopping(start: Start) -> None:
    coordinator = start()
    with coordinator.client() as client:
        study = client.post("/v1/studies", json=STUDY).json()["id"]
        with client.stream("GET", f"/v1/studies/{study}/events") as events:
            lines = events.iter_lines()
            assert next(lines) == "event: progress"
            asked = time.monotonic()
            coordinator.process.send_signal(signal.SIGTERM)
            assert list(lines)[-1] == ""
        coordinator.process.wait(20)
    assert time.monotonic() - asked < 5.0
