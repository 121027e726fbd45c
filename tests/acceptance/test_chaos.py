"""Everything goes wrong at once, and the indices do not show it. `make soak` takes longer over it.

A machine that computes wrong numbers under a lease of its own is not among the faults: whoever
looks at its trust finds it, but its results are in.
"""

import csv
import os
import random
import re
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from rehyb import Client, RehybError
from rehyb.client import Json
from server.operations import check
from server.operations.fleet import comparisons
from server.store import create_engine
from tests.testbed.fleet.adversary import Adversary
from tests.testbed.fleet.bad_lab import LEASE_SECONDS, PATIENCE, TOKEN, BadLab
from tests.testbed.studies import computed_in_one_go

#: 2 in `make test`, one on each database; more in `make soak`.
ROUNDS = int(os.environ.get("REHYB_SOAK_ROUNDS", "2"))
SHORT = ROUNDS == 2
STUDY: Json = {"name": "chaos", "model": "ishigami", "method": "saltelli", "seed": 5}
ROWS = 200 if SHORT else 400
#: By which a study grows that would be over before everything has gone wrong.
MORE_ROWS = 50
SECONDS = 900.0
BLOWS = (
    "kill worker",
    "stop worker",
    "kill coordinator",
    "kill coordinator in mid-commit",
    "kill analysis",
    "fill the database's disk",
    "set the coordinator's clock",
    "start a second coordinator",
)
#: Blows per round: after these, the study is left to end.
MOST_BLOWS = len(BLOWS) if SHORT else 12
HOUR = 3600
#: All that the coordinator may fail at, as either database says it.
DISK_FULL = "database or disk is full|No space left on device"


@pytest.fixture
def lab(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[BadLab]:
    """A laboratory with its own database: a SQLite file in odd rounds, PostgreSQL in even ones."""
    number = request.param
    if number % 2:
        url = f"sqlite:///{tmp_path}/lab.sqlite3"
    else:
        url = request.getfixturevalue("empty_database")()
    lab = BadLab(tmp_path, url, seed=number)
    yield lab
    lab.close()


@pytest.fixture(scope="module")
def totals() -> Iterator[Counter[str]]:
    """What all rounds together came to; said at their end."""
    totals: Counter[str] = Counter()
    began = time.monotonic()
    yield totals
    if totals:
        print(
            f"\n{totals['rounds']} of {ROUNDS} rounds in {time.monotonic() - began:.0f} s: "
            f"{totals['faults']} faults, {totals['lost']} of {totals['instances']} instances lost"
        )


def title(number: int) -> str:
    return f"{'sqlite' if number % 2 else 'postgresql'}-{number}"


def torment(lab: BadLab, blow: str, rng: random.Random) -> None:
    """Do one thing to one process that no process should suffer."""
    worker, coordinator = rng.choice(lab.workers), rng.choice(lab.coordinators)
    if blow == "kill worker":
        lab.signal(worker, signal.SIGKILL)
    elif blow == "stop worker":
        lab.signal(worker, signal.SIGSTOP)
        time.sleep(LEASE_SECONDS * 1.5)
        lab.signal(worker, signal.SIGCONT)
    elif blow == "kill coordinator in mid-commit":
        lab.signal(coordinator, signal.SIGUSR2)
        lab.processes[coordinator].wait(PATIENCE)
    elif blow == "fill the database's disk":
        before = len(lab.failures())
        lab.signal(coordinator, signal.SIGUSR1)
        lab.until(lambda: len(lab.failures()) > before)
        lab.signal(coordinator, signal.SIGUSR1)
    elif blow == "set the coordinator's clock":
        lab.settings[coordinator]["CLOCK_OFFSET"] = str(rng.choice((-HOUR, HOUR)))
        lab.signal(coordinator, signal.SIGKILL)
    elif blow == "start a second coordinator":
        assert (
            "a coordinator, or a `rehyb db` command, is at work on"
            in lab.start_a_second_coordinator()
        )
    elif blow == "kill coordinator":
        lab.signal(coordinator, signal.SIGKILL)
    else:
        lab.signal(blow.split()[1], signal.SIGKILL)
    time.sleep(0.3)
    lab.revive()


@pytest.mark.parametrize("lab", range(1, ROUNDS + 1), indirect=True, ids=title)
def test_whatever_goes_wrong_every_instance_counts_once_and_the_bits_are_the_same(
    lab: BadLab,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
    totals: Counter[str],
) -> None:
    number = request.node.callspec.params["lab"]
    began = time.monotonic()
    rng = random.Random(number)
    # Any number of coordinators may serve one PostgreSQL.
    blows = [b for b in BLOWS if "second" not in b or lab.database.startswith("sqlite")]
    faults: Counter[str] = Counter()
    done: Json = {}
    with Client(lab.url, TOKEN) as client:
        study = client.submit({**STUDY, "rows": ROWS})
        for machine, settings in enumerate(
            [{}, {"CLOCK_OFFSET": str(HOUR)}, {"CLOCK_OFFSET": str(-HOUR), "SMALL_DISK": "yes"}], 1
        ):
            lab.add_worker(f"worker-{machine}", **settings)
            faults["worker's clock off by an hour"] += "CLOCK_OFFSET" in settings
        lab.until(lambda: client.progress(study["id"])["ok"] > 0)
        deadline = time.monotonic() + SECONDS
        with Adversary(lab.url, TOKEN, lab.database, study) as adversary:
            while time.monotonic() < deadline:
                with suppress(RehybError):
                    study, done = client.study(study["id"]), client.indices(study["id"])
                    struck = sum(faults[blow] for blow in blows)
                    if done["rows_complete"] == study["rows"] and struck >= len(blows):
                        # Leases last so short here that one in some hundred studies has instances
                        # that are lost five times; whoever looks after it has them run again.
                        again = client.rerun(study["id"], outcomes=["lost"])["taken_back"]
                        if not again:
                            break
                        faults["lost five times"] += again
                    if client.progress(study["id"])["pending"] <= 50 and struck < len(blows):
                        # The workers were faster than the blows.
                        client.extend(study["id"], study["rows"] + MORE_ROWS)
                    if client.progress(study["id"])["pending"] > 50 and struck < MOST_BLOWS:
                        # Each once first, then any.
                        blow = blows[struck] if struck < len(blows) else rng.choice(blows)
                        faults[blow] += 1
                        torment(lab, blow, rng)
                lab.revive()
                time.sleep(0.3)
        progress = client.progress(study["id"])
        failed = client.instances(study["id"], state="failed")["instances"]
        client.results_csv(study["id"], lab.folder / "results.csv")
    engine = create_engine(lab.database)
    contradictions = check.faults(engine)
    standings = comparisons.reputations(engine)
    engine.dispose()
    faults += lab.trouble()
    for source, found in (("network", lab.network.faults), ("adversary", adversary.faults)):
        faults += Counter({f"{source}: {kind}": count for kind, count in found.items()})
    lost = study["instances"] - progress["ok"]
    with capsys.disabled():
        seconds = time.monotonic() - began
        print(f"\n{title(number)} of {ROUNDS}: {sum(faults.values())} faults in {seconds:.0f} s")
        print(f"injected: {dict(sorted(faults.items()))}")
        print(f"{sum(found.agreed for found in standings.values()) // 2} results compared")
        print(f"{lost} instances lost", flush=True)
    totals.update(rounds=1, faults=sum(faults.values()), lost=lost, instances=study["instances"])
    assert {*blows, "instance: crash", "instance: hang", "spool: disk full"} <= set(faults)
    assert lab.network.faults and adversary.faults
    assert adversary.wrong == []
    assert [words for words in lab.failures() if not re.search(DISK_FULL, words)] == []
    assert (lost, progress["state"], failed) == (0, "complete", [])
    with (lab.folder / "results.csv").open() as file:
        places = Counter((int(line["row"]), int(line["position"])) for line in csv.DictReader(file))
    assert (set(places.values()), len(places)) == ({1}, study["instances"])
    assert contradictions == []
    assert {found.trust for found in standings.values()} <= {1.0}
    assert done == computed_in_one_go(study)
