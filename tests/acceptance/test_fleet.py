"""A coordinator, its analysis and its workers on one machine, as processes that come and go."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rehyb import Client
from rehyb.errors import FleetError, Invalid
from rehyb.fleet import LocalFleet


def test_a_coordinator_that_cannot_start_is_an_error_with_its_last_words(tmp_path: Path) -> None:
    fleet = LocalFleet(tmp_path, workers=1, database_url="sqlite:////nowhere/at/all.sqlite3")
    with pytest.raises(Invalid, match=r"coordinator did not start: .*database"), fleet:
        pass
    assert fleet.pids() == {}


def test_a_directory_in_use_is_refused(tmp_path: Path) -> None:
    fleet = LocalFleet(tmp_path, workers=0)
    with (
        fleet,
        pytest.raises(FleetError, match="something else runs in"),
        LocalFleet(tmp_path, workers=0),
    ):
        pass


def test_what_dies_is_started_again_at_the_same_address(tmp_path: Path) -> None:
    with LocalFleet(tmp_path, workers=0) as fleet:
        url, before = fleet.url, fleet.pids()
        os.kill(before["coordinator"], signal.SIGKILL)
        deadline = time.monotonic() + 20
        while fleet.pids()["coordinator"] == before["coordinator"]:
            assert time.monotonic() < deadline
            fleet.supervise()
        assert fleet.url == url
        assert fleet.pids()["analysis"] == before["analysis"]


def test_up_serves_a_study_to_whoever_has_its_token_until_it_is_told_to_stop(
    tmp_path: Path,
) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("REHYB_")}
    command = ["up", "--directory", str(tmp_path), "--port", "0", "--workers", "1", "--json"]
    up = subprocess.Popen(
        [sys.executable, "-m", "rehyb", *command],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert up.stdout is not None
        printed = ""
        for line in up.stdout:
            printed += line
            if line == "}\n":
                break
        place = json.loads(printed)
        with Client(place["url"], place["token"]) as client:
            study = client.submit(
                {"name": "n", "model": "ishigami", "method": "morris", "rows": 20}
            )
            last = client.wait(study["id"], poll_seconds=0.1)
        assert (last["state"], last["ok"]) == ("complete", 80)
        up.terminate()
        assert up.wait(30) == 130
        assert "Traceback" not in (tmp_path / "logs" / "coordinator.log").read_text()
        assert "Traceback" not in (tmp_path / "logs" / "analysis.log").read_text()
    finally:
        up.kill()
        up.communicate()
