"""A study survives what happens to machines, and its indices do not show that anything happened."""

import csv
import os
import signal
import time
from collections import Counter
from pathlib import Path

import pytest

from rehyb import Client, Unreachable
from rehyb.client import Json
from tests.testbed.fleet.warm import WarmFleet
from tests.testbed.studies import computed_in_one_go

#: Takes a few seconds, so that every blow falls in its midst.
STUDY: Json = {
    "name": "survivor",
    "model": "ishigami",
    "method": "saltelli",
    "rows": 1000,
    "seed": 3,
}
WIDTH = 5


def test_killed_workers_coordinators_and_analyses_leave_no_trace_in_the_indices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What a killed worker held is given to others after this time.
    monkeypatch.setenv("REHYB_LEASE_SECONDS", "2")
    blows = [(0.1, "worker-1"), (0.25, "coordinator"), (0.45, "analysis"), (0.6, "coordinator")]
    with WarmFleet(tmp_path, workers=2) as fleet, Client(fleet.url, fleet.token) as client:
        study = client.submit(STUDY)
        instances = study["instances"]
        assert instances == STUDY["rows"] * WIDTH
        deadline = time.monotonic() + 90.0
        while time.monotonic() < deadline:
            fleet.supervise()
            try:
                progress = client.progress(study["id"])
                indices = client.indices(study["id"])
            except Unreachable:
                time.sleep(0.05)
                continue
            if blows and progress["ok"] >= blows[0][0] * instances:
                assert progress["state"] == "running"
                os.kill(fleet.pids()[blows.pop(0)[1]], signal.SIGKILL)
            elif indices["rows_complete"] == STUDY["rows"]:
                break
            time.sleep(0.05)
        assert not blows
        assert progress["state"] == "complete"
        assert (progress["ok"], progress["failed"]) == (instances, 0)
        client.results_csv(study["id"], tmp_path / "results.csv")

    with (tmp_path / "results.csv").open() as file:
        places = Counter((int(line["row"]), int(line["position"])) for line in csv.DictReader(file))
    assert set(places.values()) == {1}
    assert set(places) == {(r, p) for r in range(STUDY["rows"]) for p in range(WIDTH)}
    assert indices == computed_in_one_go(study)
