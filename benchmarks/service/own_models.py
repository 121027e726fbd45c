"""How many evaluations a second one worker of two processes gives, the coordinator between.

`python -m benchmarks.service.own_models` measures rehyb's own Ishigami function and the same as a
Python program that is kept (`examples/models/ishigami_python`), a study each.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import psutil

from benchmarks.machine import describe_machine
from models.processes import children, descendants
from rehyb.client import Client
from rehyb.fleet import LocalFleet

EXAMPLE = Path(__file__).parents[2] / "examples" / "models" / "ishigami_python"
MODELS = ("ishigami", "ishigami_python")
#: Seconds that are counted, after as many results.
SECONDS, AFTER = 15.0, 2000
#: Rows of five instances, more than are finished in that time.
ROWS = 100_000
#: Instances that a worker asks for at once, at most.
BATCH = 1000


def cpu_seconds(pids: Mapping[str, list[int]]) -> dict[str, float]:
    """Return the processor time that groups of processes have taken, s."""
    found = dict.fromkeys(pids, 0.0)
    for name, group in pids.items():
        for pid in group:
            with suppress(psutil.Error):
                times = psutil.Process(pid).cpu_times()
                found[name] += times.user + times.system
    return found


def everybody(fleet: LocalFleet, worker: int) -> dict[str, list[int]]:
    """Return the processes at work by what they do."""
    evaluating = children(worker)
    programs = [pid for child in evaluating for pid in descendants(child)]
    own = {name: [pid] for name, pid in fleet.pids().items()}
    return {**own, "worker": [worker], "evaluating": evaluating, "programs": programs}


def measured(client: Client, model: str, fleet: LocalFleet, worker: int) -> str:
    """Return a line with evaluations a second, and the processor time of each."""
    study = client.submit(
        {"name": model, "model": model, "method": "saltelli", "rows": ROWS, "seed": 1}
    )["id"]
    while (begun := client.progress(study)["ok"]) < AFTER:
        time.sleep(0.1)
    started, pids = time.monotonic(), everybody(fleet, worker)
    before = cpu_seconds(pids)
    time.sleep(SECONDS)
    progress, seconds = client.progress(study), time.monotonic() - started
    done = progress["ok"] - begun
    taken = {name: (s - before[name]) / done * 1e3 for name, s in cpu_seconds(pids).items()}
    assert not progress["failed"], progress["failures"]
    client.cancel(study)
    parts = ", ".join(f"{name} {ms:.2f}" for name, ms in taken.items())
    return (
        f"{model:16} {done / seconds:6.0f} evaluations/s; {sum(taken.values()):.2f} ms of "
        f"processor time for each ({parts}): at most {2e3 / sum(taken.values()):.0f}/s on two cores"
    )


def main() -> None:
    print(describe_machine())
    with (
        tempfile.TemporaryDirectory() as directory,
        LocalFleet(Path(directory), workers=0) as fleet,
    ):
        environment = os.environ | {
            "REHYB_URL": fleet.url,
            "REHYB_TOKEN": fleet.token,
            "XDG_STATE_HOME": directory,
        }
        options = ["--processes", "2", "--batch", str(BATCH), "--models", str(EXAMPLE)]
        worker = subprocess.Popen(
            [sys.executable, "-m", "worker", *options],
            env=environment,
            stderr=subprocess.DEVNULL,
        )
        try:
            with Client(fleet.url, fleet.token) as client:
                while MODELS[1] not in {model["name"] for model in client.models()}:
                    time.sleep(0.1)
                for model in MODELS:
                    print(measured(client, model, fleet, worker.pid), flush=True)
        finally:
            worker.terminate()
            worker.wait()


if __name__ == "__main__":
    main()
