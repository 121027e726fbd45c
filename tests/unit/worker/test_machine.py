"""What a worker says of its machine, and what the doctor finds."""

import socket
from collections.abc import Callable
from datetime import UTC, datetime
from email.utils import format_datetime
from pathlib import Path

import httpx2
import pytest

from rehyb.client import Client
from rehyb.errors import Invalid, RehybError
from sim.evaluation import code
from tests.testbed.transport import CoordinatorTransport
from worker.doctor import Finding, examine
from worker.machine import CanaryError, canary, cpu, new_id

FAST = 'print(\'["c0ffee", 0.4, ["elbow@1"]]\')'


@pytest.fixture
def healthy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.doctor.canary", lambda: ("c0ffee", 0.4, []))


def verdicts(findings: list[Finding]) -> dict[str, str]:
    return {finding.check: finding.verdict for finding in findings}


def examined(tmp_path: Path, answer: Callable[[httpx2.Request], httpx2.Response]) -> list[Finding]:
    def connect() -> Client:
        return Client("http://c", "t", transport=CoordinatorTransport(answer))

    return list(examine(spool=tmp_path / "spool", connect=connect))


def coordinator(
    *, now: datetime | None = None, status: int = 200
) -> Callable[[httpx2.Request], httpx2.Response]:
    date = format_datetime(now or datetime.now(UTC), usegmt=True)

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.url.path == "/healthz":
            return httpx2.Response(200, json={"status": "ok"}, headers={"Date": date})
        body = {"workers": [], "status": status, "detail": "not with this token"}
        return httpx2.Response(status, json=body)

    return answer


def test_the_code_of_the_simulation_has_one_digest() -> None:
    assert code() == code()
    assert len(code()) == 16


def test_a_changed_device_is_changed_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot is a file of the simulation's, and decides the bits as its modules do."""
    monkeypatch.setattr("sim.evaluation.__file__", str(tmp_path / "evaluation.py"))
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    before = code()
    (tmp_path / "robot.xml").write_text('<mujoco model="other"/>')
    assert code() != before


def test_a_canary_that_dies_is_one_sentence() -> None:
    assert canary(FAST) == ("c0ffee", 0.4, ["elbow@1"])
    with pytest.raises(CanaryError, match=r"cannot be evaluated on this machine: .*no AVX"):
        canary("raise SystemExit('no AVX')")
    with pytest.raises(CanaryError, match="exit status -11"):
        canary("import os; os.kill(os.getpid(), 11)")


def test_a_canary_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.machine.CANARY_SECONDS", 0.1)
    with pytest.raises(CanaryError, match=r"more than 0\.1 s"):
        canary("import time; time.sleep(60)")


@pytest.mark.usefixtures("healthy")
def test_a_good_machine_has_nothing_wrong(tmp_path: Path) -> None:
    found = verdicts(examined(tmp_path, coordinator()))
    assert {"simulation", "spool", "coordinator", "clock", "token"} <= set(found)
    assert "failure" not in found.values()
    assert found["clock"] == found["token"] == "ok"


@pytest.mark.usefixtures("healthy")
def test_a_wrong_clock_is_a_warning_and_a_wrong_token_a_failure(tmp_path: Path) -> None:
    an_hour_off = coordinator(now=datetime.fromtimestamp(0, UTC), status=401)
    found = verdicts(examined(tmp_path, an_hour_off))
    assert (found["clock"], found["token"]) == ("warning", "failure")


@pytest.mark.usefixtures("healthy")
def test_a_token_only_good_for_work_is_good(tmp_path: Path) -> None:
    assert verdicts(examined(tmp_path, coordinator(status=403)))["token"] == "ok"


def test_a_machine_that_cannot_simulate_or_spool_or_reach_anybody_fails_thrice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash() -> tuple[str, float, list[str]]:
        raise CanaryError("it crashed")

    def no_way() -> Client:
        raise RehybError("nobody answers")

    monkeypatch.setattr("worker.doctor.canary", crash)
    (tmp_path / "spool").write_text("a file, where a folder should be")
    found = verdicts(list(examine(spool=tmp_path / "spool", connect=no_way)))
    assert [check for check, verdict in found.items() if verdict == "failure"] == [
        "simulation",
        "spool",
        "coordinator",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("flags : fpu sse4_2 avx avx2 bmi2 fma ibrs\n", "sse4_2 avx avx2 fma"),
        ("Features : fp asimd crc32\n", "asimd"),
        ("flags : fpu sse2\n", "none"),
    ],
)
def test_a_processor_is_known_by_its_vector_instructions(
    tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / "cpuinfo").write_text(text)
    assert cpu(tmp_path / "cpuinfo") == words
    assert cpu(tmp_path / "not linux") == "unknown"


def test_the_id_of_a_worker_begins_with_its_group_and_is_nobody_elses() -> None:
    assert len({new_id("day-2") for _ in range(3)}) == 3
    assert new_id("day-2").startswith(f"day-2@{socket.gethostname()}-")
    assert new_id("").startswith(f"{socket.gethostname()}-")


def test_whatever_a_host_is_called_the_id_of_its_worker_names_no_other_group_and_a_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "day@../höhle")
    assert new_id("").startswith("day-..-h-hle-")
    monkeypatch.setattr(socket, "gethostname", lambda: "änne")
    assert new_id("").startswith("nne-")
    monkeypatch.setattr(socket, "gethostname", lambda: "é")
    assert new_id("").startswith("host-")


@pytest.mark.parametrize("group", ["../x", "a b", "-a", "a" * 41])
def test_a_group_that_no_file_can_be_named_by_is_refused(group: str) -> None:
    with pytest.raises(Invalid, match="REHYB_WORKER_GROUP is up to 40 letters"):
        new_id(group)
