"""Closing the loop through the service, with a real coordinator and real workers."""

import hashlib
import io
import json
import os
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import psutil
import pytest

from analysis.closeloop.contract import REPORT_FILES
from analysis.closeloop.loop import close_loop
from server.operations import check, sessions
from server.store import close_loops, create_engine
from server.store.database.engine import reading
from tests.testbed.fleet.lab import TOKEN, Lab, until
from tests.testbed.sessions.synthetic import write_session

SEED = 3
#: Few trials: a second or two of work.
SMALL: dict[str, Any] = {"speeds": (0.8, 1.6), "postures": (0.1,), "rate": 250.0}


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    monkeypatch.setenv("REHYB_LEASE_SECONDS", "4")
    lab = Lab(tmp_path)
    yield lab
    lab.close()


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """A zipped session whose motor rubs."""
    write_session(tmp_path / "monday", SEED, ("coulomb_friction",), **SMALL)
    path = tmp_path / "monday.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in sorted((tmp_path / "monday").iterdir()):
            packed.write(file, f"monday/{file.name}")
    return path


def child_of(worker: subprocess.Popen[bytes]) -> int:
    """Return the process id of the child that closes the loop."""
    found: list[int] = []

    def look() -> bool:
        for child in psutil.Process(worker.pid).children():
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child.pid)
        return bool(found)

    until(look)
    return found[0]


def submitted(lab: Lab, session: Path, out: Path) -> subprocess.Popen[str]:
    command = ("close-loop", str(session), "--out", str(out), "--submit", "--json")
    return subprocess.Popen(
        [sys.executable, "-m", "rehyb", *command],
        env=lab.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def events(lab: Lab, job: str) -> Iterator[dict[str, Any]]:
    """Yield what the coordinator streams about a job until its end."""
    url = f"{lab.environment['REHYB_URL']}/v1/close-loops/{job}/events"
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with httpx2.stream("GET", url, headers=headers, timeout=60.0) as stream:
        for line in stream.iter_lines():
            if line.startswith("data: "):
                yield json.loads(line.removeprefix("data: "))


def test_the_report_through_the_service_is_the_one_made_here(lab: Lab, tmp_path: Path) -> None:
    write_session(tmp_path / "monday", SEED, ("coulomb_friction",), **SMALL)
    command = submitted(lab, tmp_path / "monday", tmp_path / "remote")
    until(lab.client.sessions)
    (session,) = lab.client.sessions()
    job = lab.client.close_loop(session["id"])
    assert "no worker" in job["note"]
    worker = lab.start_worker()
    told = list(events(lab, job["id"]))
    assert [told[0]["state"], told[-1]["state"]] == ["waiting", "done"]
    assert len({one["progress"] for one in told if one["state"] == "running"} - {""}) >= 2
    expected = close_loop(tmp_path / "monday", tmp_path / "local")
    over_rest = lab.client.close_loop_report(job["id"])
    assert over_rest == {
        **expected,
        "id": job["id"],
        "session_id": session["id"],
        "state": "done",
    }
    printed, _ = command.communicate(timeout=30)
    assert (command.returncode, json.loads(printed)) == (0, expected)
    for name in REPORT_FILES:
        remote, local = (tmp_path / where / name for where in ("remote", "local"))
        assert remote.read_bytes() == local.read_bytes()
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(20) == 0
    assert not list((lab.folder / "spool").iterdir())


def test_a_bad_session_ends_the_command_as_it_does_here(lab: Lab, tmp_path: Path) -> None:
    write_session(tmp_path / "monday", SEED, (), **SMALL)
    trial = tmp_path / "monday" / "p0_v0.csv"
    trial.write_text(trial.read_text().replace("time", "clock", 1))
    command = submitted(lab, tmp_path / "monday", tmp_path / "out")
    _, said = command.communicate(timeout=60)
    assert command.returncode == 2
    assert "p0_v0.csv, column time, line 1: " in said and len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists() and lab.client.sessions() == []


def test_crash_and_silence_cost_an_attempt_each_and_there_is_one_report(
    lab: Lab, archive: Path
) -> None:
    session = lab.client.upload_session(archive)
    job = lab.client.close_loop(session["id"])["id"]
    first = lab.start_worker()
    until(lambda: lab.client.close_loop_report(job).get("progress"))
    os.kill(child_of(first), signal.SIGKILL)

    def is_at_it_again() -> bool:
        now = lab.client.close_loop_report(job)
        return len(now["attempts"]) == 2 and bool(now["progress"])

    until(is_at_it_again)
    child = child_of(first)
    os.kill(child, signal.SIGSTOP)
    first.kill()
    first.wait()
    until(lambda: not psutil.pid_exists(child))
    assert list((lab.folder / "spool" / "loops").iterdir())
    second = lab.start_worker()
    assert lab.client.wait_for_report(job)["verdict"] == "effect_found"
    engine = create_engine(lab.environment["REHYB_DATABASE_URL"])
    with reading(engine) as connection:
        attempts = close_loops.find(connection, job).attempts
    assert [attempt.ended for attempt in attempts] == ["crashed", "lost", "done"]
    assert "SIGKILL" in attempts[0].reason
    assert check.faults(engine) == []
    engine.dispose()
    second.send_signal(signal.SIGTERM)
    assert second.wait(20) == 0
    # What the first one left is gone, too.
    assert [path.suffix for path in (lab.folder / "spool").iterdir()] == []


def test_a_session_that_turns_out_bad_at_the_worker_is_a_problem_with_its_sentence(
    lab: Lab, archive: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as packed:
        packed.writestr("session.json", '{"schema": 2}')
    content = (tmp_path / "bad.zip").read_bytes()
    engine = create_engine(lab.environment["REHYB_DATABASE_URL"])
    # As a coordinator with another reader would have taken it.
    kept, _ = sessions.create(
        engine,
        io.BytesIO(content),
        name="bad",
        sha256=hashlib.sha256(content).hexdigest(),
        size=len(content),
        content={},
        now=1.0,
    )
    engine.dispose()
    job = lab.client.close_loop(kept.id)["id"]
    lab.start_worker()
    told = lab.client.wait_for_report(job)
    assert (told["state"], told["problem"]["status"]) == ("failed", 422)
    assert told["problem"]["detail"] == "session.json: schema must be 1, not 2"
    assert told["problem"]["file"] == "session.json"
    assert [attempt["ended"] for attempt in told["attempts"]] == ["bad_session"]


def test_a_large_session_does_not_fill_the_coordinator_s_memory(
    lab: Lab, archive: Path, tmp_path: Path
) -> None:
    def peak() -> int:
        status = Path(f"/proc/{lab.coordinator.pid}/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) * 1024

    size = 100_000_000
    with zipfile.ZipFile(archive, "a", zipfile.ZIP_STORED) as packed:
        packed.writestr("monday/film.bin", os.urandom(size))
    before = peak()
    session = lab.client.upload_session(archive)
    lab.client.session_archive(session["id"], tmp_path / "back.zip")
    assert (tmp_path / "back.zip").read_bytes() == archive.read_bytes()
    assert peak() - before < 0.5 * size


def test_a_worker_that_lacks_the_pictures_is_given_none(lab: Lab, archive: Path) -> None:
    job = lab.client.close_loop(lab.client.upload_session(archive)["id"])["id"]
    light = "import sys; sys.modules['matplotlib'] = None; from worker.cli import main; main()"
    options = ("--spool", str(lab.folder / "spool"), "--processes", "1", "--max-idle", "1.5")
    ran = subprocess.run(
        [sys.executable, "-c", light, *options],
        env=lab.environment,
        capture_output=True,
        timeout=60,
        check=True,
    )
    assert b"no work for 1.5 s" in ran.stderr
    assert lab.client.workers()
    standing = lab.client.close_loop_report(job)
    assert (standing["state"], standing["attempts"]) == ("waiting", [])
    assert "no worker that can close loops" in standing["note"]
