"""The two-phase study as a person runs it: from one command, interrupted, and run again."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROWS = ("--screening-rows", "128", "--variance-rows", "500")


@contextmanager
def ending(directory: Path) -> Iterator[Path]:
    """Have a campaign's directory; whatever a failed test leaves running there is ended."""
    try:
        yield directory
    finally:
        for pid in processes_of(directory):
            os.kill(pid, signal.SIGKILL)


@pytest.fixture
def directory(tmp_path: Path) -> Iterator[Path]:
    with ending(tmp_path / "campaign") as directory:
        yield directory


def start(directory: Path, *options: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "rehyb", "campaign", "run", "--preset", "demo"]
    command += ["--model", "sobol_g", "--local-workers", "2", "--directory", str(directory)]
    return subprocess.Popen(
        [*command, *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Who runs the tests in the background has Ctrl-C ignored, and so have all that they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def processes_of(directory: Path) -> list[int]:
    """Return the processes that were started for the fleet in `directory`, children included."""
    mark = f"{directory}/rehyb.sqlite3".encode()
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (process / "environ").read_bytes():
                found.append(int(process.name))
        except OSError:
            continue
    return found


def wait_for_results(directory: Path, *, phase: int) -> None:
    """Wait until a phase is under way."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        with suppress(sqlite3.OperationalError), closing(database_of(directory)) as database:
            studies = database.execute("SELECT result_count FROM studies").fetchall()
            over = (directory / "phase1.json").exists()
            if len(studies) >= phase and min(studies)[0] > 0 and (phase == 1 or over):
                return
        time.sleep(0.02)
    raise AssertionError(f"phase {phase} had no result within 60 s")


def database_of(directory: Path) -> sqlite3.Connection:
    """Open a campaign's database; OperationalError as long as there is none."""
    return sqlite3.connect(f"file:{directory}/rehyb.sqlite3?mode=rw", uri=True)


@dataclass(frozen=True)
class Resumed:
    """A campaign that Ctrl-C interrupted in phase 2 and the same command finished."""

    directory: Path
    #: What was decided and written when it was interrupted.
    decision: dict[str, Any]
    phase1: bytes
    #: What the second command printed and said.
    report: dict[str, Any]
    words: str


@pytest.fixture(scope="module")
def resumed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Resumed]:
    with ending(tmp_path_factory.mktemp("resumed") / "campaign") as directory:
        first = start(directory, *ROWS)
        wait_for_results(directory, phase=2)
        assert processes_of(directory)
        first.send_signal(signal.SIGINT)
        _, words = first.communicate(timeout=40)
        assert first.returncode == 130
        assert "run the same command again" in words
        assert "Traceback" not in words
        assert processes_of(directory) == []
        decision = json.loads((directory / "campaign.json").read_text())["decision"]
        phase1 = (directory / "phase1.csv").read_bytes()

        second = start(directory, *ROWS, "--json")
        out, words = second.communicate(timeout=90)
        assert second.returncode == 0, words
        assert processes_of(directory) == []
        yield Resumed(directory, decision, phase1, json.loads(out), words)


def test_an_interrupted_campaign_leaves_nothing_running_and_resumes_to_the_same_end(
    resumed: Resumed,
) -> None:
    assert (resumed.directory / "phase1.csv").read_bytes() == resumed.phase1
    assert {key: resumed.report[key] for key in resumed.decision} == resumed.decision
    with closing(database_of(resumed.directory)) as database:
        studies = database.execute("SELECT state, instances, result_count FROM studies").fetchall()
    assert sorted(studies) == [("complete", 896, 896), ("complete", 3500, 3500)]


def test_a_campaign_finds_what_matters_and_says_where_it_is_written(resumed: Resumed) -> None:
    directory, report = resumed.directory, resumed.report
    assert report["fixed"] in ("x5", "x6")
    assert report["separated"] is True
    assert (report["failures"], report["instances"]) == ({}, 128 * 7 + 500 * 7)
    factors = report["phase2"]["outputs"]["y"]["factors"]
    assert report["fixed"] not in factors
    totals = {name: entry["total_order"]["value"] for name, entry in factors.items()}
    assert sorted(totals, key=totals.__getitem__, reverse=True)[:2] == ["x1", "x2"]
    # Closed form, Saltelli and Sobol 1995, for the five factors left at a = (0, 1, 4.5, 9, 99).
    entry = factors["x1"]["total_order"]
    assert entry["low"] < 0.787 < entry["high"]
    for path in report["files"]:
        assert Path(path).stat().st_size > 0
    assert {Path(path).name for path in report["files"]} >= {"campaign.png", "phase2.csv"}
    figures = [path.name for path in sorted((directory / "figures").iterdir())]
    assert [name.split("-")[1] for name in figures] == ["morris"] * 5 + ["saltelli"] * 5
    assert all((directory / "figures" / name).read_bytes()[:4] == b"\x89PNG" for name in figures)
    assert (directory / "token").stat().st_mode & 0o777 == 0o600
    assert "failures: none" in resumed.words


def test_sigkill_of_the_command_leaves_nothing_running(directory: Path) -> None:
    campaign = start(directory, *ROWS)
    wait_for_results(directory, phase=1)
    assert processes_of(directory)
    campaign.kill()
    campaign.communicate(timeout=10)
    deadline = time.monotonic() + 30.0
    while processes_of(directory) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert processes_of(directory) == []


def test_a_campaign_asks_before_it_fixes_and_grows_to_the_precision_wanted(
    directory: Path,
) -> None:
    # So few instances are done before a second worker would have started.
    sizes = ("--screening-rows", "12", "--variance-rows", "16", "--up-to", "128")
    sizes += ("--local-workers", "1")
    options = (*sizes, "--target", "0.25", "--confirm", "--json")
    first = start(directory, *options)
    out, words = first.communicate("no\n", timeout=180)
    assert (first.returncode, out) == (1, "")
    assert "has the least influence on y" in words and "and go on?" in words
    assert "rehyb: nothing was fixed, and phase 2 waits" in words.splitlines()[-1]
    assert processes_of(directory) == []

    second = start(directory, *options)
    out, words = second.communicate("leg\nx4\n", timeout=180)
    assert second.returncode == 0, words
    assert "There is no factor 'leg': x" in words
    report = json.loads(out)
    assert report["fixed"] == "x4" and "Asked, the user fixed x4 instead." in report["evidence"]
    rows = report["phase2"]["rows"]
    assert rows in (32, 64, 128) and report["phase2"]["rows_complete"] == rows
    assert f"{rows} of {rows} complete" in (directory / "report.html").read_text()
