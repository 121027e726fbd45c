"""A fleet keeps its token to its owner, and patience with a coordinator that waits."""

import sys
import time
from pathlib import Path

import pytest

from rehyb.errors import FleetError, Invalid
from rehyb.fleet import DEATHS, LISTENING, LocalFleet, _Process


def test_a_token_is_made_once_and_is_for_its_owner_only(tmp_path: Path) -> None:
    first = LocalFleet(tmp_path, workers=1)
    assert len(first.token) >= 32
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
    assert LocalFleet(tmp_path, workers=1).token == first.token


def test_no_half_of_a_token_is_kept_on_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as full:
        full.setattr("os.fdopen", lambda *_: open("/dev/full", "w"))  # noqa: PTH123, SIM115
        with pytest.raises(OSError, match=f"No space left on device: '{tmp_path}/token'"):
            LocalFleet(tmp_path, workers=1)
    assert LocalFleet(tmp_path, workers=1).token


def test_a_given_token_is_used_and_not_written_down(tmp_path: Path) -> None:
    assert LocalFleet(tmp_path, workers=1, token="given").token == "given"
    assert list(tmp_path.iterdir()) == []


def test_a_given_token_is_one_that_requests_can_bear(tmp_path: Path) -> None:
    assert LocalFleet(tmp_path, workers=1, token="given\n").token == "given"
    with pytest.raises(FleetError, match="no request can bear") as refused:
        LocalFleet(tmp_path, workers=1, token="hush hush")
    assert "hush" not in str(refused.value)


@pytest.mark.parametrize("inside", ["", "fleet"])
def test_a_file_is_no_directory_and_named(tmp_path: Path, inside: str) -> None:
    file = tmp_path / "notes.txt"
    file.touch()
    with pytest.raises(Invalid, match=f"^{file / inside} is no folder, .* name one"):
        LocalFleet(file / inside, workers=1)


#: Waits for three seconds, and says so.
WAITS = """
import time
away = "the database is away, and waited for: its server does not answer"
print('{"event": "' + away + '", "level": "warning"}', flush=True)
time.sleep(3.0)
print('{"event": "the database is back", "level": "warning"}', flush=True)
"""
LISTENS = "print('listening on http://127.0.0.1:8787', flush=True); time.sleep(9.0)"


@pytest.mark.parametrize("then", [LISTENS, "time.sleep(9.0)"])
def test_only_the_time_that_a_coordinator_itself_takes_to_start_is_limited(
    tmp_path: Path, then: str
) -> None:
    told: list[str] = []
    process = _Process(
        "coordinator", [sys.executable, "-c", WAITS + then], {}, tmp_path / "l" / "c"
    )
    try:
        if then == LISTENS:
            assert process.wait_for(LISTENING, 1.5, told.append)[2] == "8787"
        else:
            with pytest.raises(FleetError, match=r"was not ready after 1\.5 s"):
                process.wait_for(LISTENING, 1.5, told.append)
    finally:
        process.kill()
    waits = "the database is away, and waited for: its server does not answer; Ctrl-C gives up"
    assert told == [waits]


@pytest.mark.parametrize(
    ("ends", "how"),
    [
        ("import os; os.kill(os.getpid(), 9)", "by SIGKILL and with no word"),
        ("import sys; sys.exit('out of luck')", "with status 1 and with out of luck"),
    ],
)
def test_a_process_that_dies_again_and_again_ends_the_fleet_which_says_how_it_died(
    tmp_path: Path, ends: str, how: str
) -> None:
    process = _Process("worker-1", [sys.executable, "-S", "-c", ends], {}, tmp_path / "l" / "w")
    deadline = time.monotonic() + 20.0
    with pytest.raises(FleetError, match=f"the worker-1 died {DEATHS} times .*, last {how} "):
        while time.monotonic() < deadline:
            process.revive()
            time.sleep(0.01)


@pytest.mark.parametrize(("status", "kind"), [(2, Invalid), (1, FleetError)])
def test_a_coordinator_that_was_told_something_impossible_is_no_failure_but_a_mistake(
    tmp_path: Path, status: int, kind: type[Exception]
) -> None:
    ends = f"import sys; print('rehyb: no'); sys.exit({status})"
    process = _Process("coordinator", [sys.executable, "-S", "-c", ends], {}, tmp_path / "l" / "c")
    with pytest.raises(kind, match=r"^the coordinator did not start: no "):
        process.wait_for(LISTENING, 20.0, lambda _: None)
