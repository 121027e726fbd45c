"""`rehyb pilots` on the batch systems that are here: this machine, and Slurm where `sbatch` is.

`scripts/slurm_one_node.sh start FOLDER` starts a Slurm of one node; SLURM_CONF names its file.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rehyb import Client
from rehyb.cli.models import added
from rehyb.client import Json
from rehyb.pilots.engines import JobState, ParslEngine
from rehyb.pilots.keeper import Keeper, Status
from rehyb.pilots.settings import checked
from tests.testbed.fleet.warm import WarmFleet
from tests.testbed.models import EXAMPLES
from tests.testbed.studies import computed_in_one_go

STUDY: Json = {"name": "p", "method": "saltelli", "rows": 200, "seed": 11}
#: Seconds that an instance takes, so that studies last as long on every machine.
INSTANCE_SECONDS = 0.05
LEASE_SECONDS = 3
#: Of a pilot.
WALLTIME = 600.0
#: Seconds for everything that may take a while.
PATIENCE = 120.0
#: For a whole study.
STUDY_SECONDS = 400.0


@dataclass
class Site:
    """A coordinator and a batch system."""

    fleet: WarmFleet
    client: Client
    keeper: Keeper
    #: The Ishigami function, slowly: what a study samples.
    model: str

    def submit(self, study: Json) -> Json:
        return self.client.submit({**study, "model": self.model})

    def look_until(self, done: Callable[[Status], bool], seconds: float = PATIENCE) -> Status:
        deadline = time.monotonic() + seconds
        while True:
            status = self.keeper.look(time.monotonic())
            if done(status):
                return status
            assert time.monotonic() < deadline, status
            time.sleep(0.5)

    def look_until_done(self, study: Json, share: float) -> None:
        """Look until this share of a study has results; it still runs then."""

        def done(_: Status) -> bool:
            progress = self.client.progress(study["id"])
            assert progress["state"] == "running"
            enough: bool = progress["ok"] >= share * study["instances"]
            return enough

        self.look_until(done)

    def running(self) -> list[str]:
        return [job for job, state in self.keeper.jobs.items() if state == JobState.RUNNING]


@pytest.fixture(scope="module")
def slurm() -> None:
    if shutil.which("sbatch") is None:
        pytest.skip("there is no sbatch here: scripts/slurm_one_node.sh start FOLDER makes one")
    if subprocess.run(["sinfo"], capture_output=True, check=False).returncode:
        pytest.skip("sbatch is here, but no Slurm answers: is SLURM_CONF set?")


def slow_ishigami(folder: Path) -> Path:
    """Write a model of one's own to a folder, and return it."""
    shutil.copytree(EXAMPLES / "ishigami_python", folder)
    program = folder / "ishigami.py"
    line = "for line in sys.stdin:\n"
    slowly = f"{line}    time.sleep({INSTANCE_SECONDS})\n"
    program.write_text("import time\n" + program.read_text().replace(line, slowly))
    return folder


def engine_for(provider: str, folder: Path) -> ParslEngine:
    """Return a batch system for the pilots of a folder."""
    return ParslEngine(
        provider,
        folder=folder / "pilots",
        walltime=WALLTIME,
        cores=1,
        before=f"export XDG_STATE_HOME={folder / 'state'}",
        options={},
    )


@pytest.fixture
def site(
    tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Site]:
    slow = slow_ishigami(tmp_path / "model")
    said: dict[str, Any] = {
        "provider": request.param,
        # Longer than a busy machine takes to the moment at which Slurm is told to end one.
        "walltime": WALLTIME,
        "cores": 1,
        "maximum": 2,
        "starts_a_minute": 60,
        "idle": 3,
        "instance": 30,
        "worker": f"{sys.executable} -m worker --batch 1 --models {slow}",
    }
    if request.param == "slurm":
        request.getfixturevalue("slurm")
    settings = checked(said)
    folder = tmp_path / "pilots"
    # What a killed pilot held is given to others after this time.
    monkeypatch.setenv("REHYB_LEASE_SECONDS", str(LEASE_SECONDS))
    with WarmFleet(tmp_path / "fleet", workers=0) as fleet:
        engine = engine_for(settings.provider, tmp_path)
        with Client(fleet.url, fleet.token) as client:
            keeper = Keeper(
                settings=settings, engine=engine, client=client, token=fleet.token, folder=folder
            )
            keeper.prepare()
            try:
                yield Site(fleet=fleet, client=client, keeper=keeper, model=added(client, slow))
            finally:
                keeper.end()


def control(*words: str) -> None:
    """Do what whoever looks after a Slurm does."""
    subprocess.run(["scontrol", *words], check=True, capture_output=True)


def finished(site: Site, study: Json) -> None:
    """Check that a study ends, that its pilots leave, and that its indices show nothing."""
    site.look_until(
        lambda _: site.client.progress(study["id"])["state"] == "complete", STUDY_SECONDS
    )
    site.look_until(lambda status: status.pilots_running + status.pilots_waiting == 0)
    deadline = time.monotonic() + 20.0
    while (found := site.client.indices(study["id"]))["rows_complete"] < study["rows"]:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert found == computed_in_one_go({**study, "model": "ishigami"})


@pytest.mark.parametrize("site", ["local"], indirect=True)
def test_pilots_come_are_killed_and_leave_and_the_indices_do_not_show_it(site: Site) -> None:
    study = site.submit(STUDY)
    site.look_until(lambda status: status.pilots_running == 2)
    site.look_until_done(study, 0.1)
    # All of one, at once.
    os.killpg(os.getpgid(int(site.running()[0])), signal.SIGKILL)
    killed_at = time.monotonic()
    site.look_until(lambda status: status.submitted == 3 and status.pilots_running == 2)
    site.look_until_done(study, 0.3)
    # By then the coordinator has taken back what the killed one ran and what it was to run next.
    site.look_until(lambda _: time.monotonic() > killed_at + 2.0 * LEASE_SECONDS)
    seen: list[Status] = []
    site.keeper.drain(time.sleep, seen.append)
    assert seen[-1].pilots_running == 0 and len(seen) < 15
    assert site.client.progress(study["id"])["leased"] == 0, "all was given back"
    site.keeper.prepare()
    finished(site, study)


@pytest.mark.parametrize("site", ["local"], indirect=True)
def test_what_pilots_cannot_take_starts_none_after_the_first_and_other_work_does_at_once(
    site: Site,
) -> None:
    tagged = site.submit({**STUDY, "tags": ["gpu"]})
    known = site.look_until(lambda status: status.waiting == 0)
    assert f"study {tagged['id']} is for workers tagged gpu" in known.trouble
    # Idle for three seconds, they leave.
    site.look_until(lambda status: status.pilots_running + status.pilots_waiting == 0)
    until = time.monotonic() + 5.0
    after = site.look_until(lambda _: time.monotonic() > until)
    assert after.submitted == known.submitted <= 2
    study = site.submit({**STUDY, "rows": 20})
    assert site.keeper.look(time.monotonic()).submitted == known.submitted + 2
    finished(site, {**study, "rows": 20})


@pytest.mark.parametrize("site", ["local", "slurm"], indirect=True)
def test_the_next_rehyb_pilots_starts_none_before_those_of_a_killed_one_have_left(
    site: Site, tmp_path: Path
) -> None:
    study = site.submit({**STUDY, "rows": 60})
    site.look_until(lambda status: status.pilots_running == 2)
    site.look_until_done(study, 0.1)
    killed = site.keeper
    site.keeper = Keeper(
        settings=killed.settings,
        engine=engine_for(killed.settings.provider, tmp_path),
        client=killed.client,
        token=killed.token,
        folder=killed.folder,
    )
    site.keeper.prepare()
    first = site.keeper.look(time.monotonic())
    assert (first.pilots_leaving, first.submitted) == (2, 0)

    def two_run(status: Status) -> bool:
        assert status.pilots_leaving + status.pilots_waiting + status.pilots_running <= 2
        return status.pilots_running == 2

    site.look_until(two_run)
    finished(site, {**study, "rows": 60})


@pytest.mark.parametrize("site", ["slurm"], indirect=True)
def test_on_slurm_a_study_outlives_scancel_walltime_and_a_drained_node(site: Site) -> None:
    study = site.submit({**STUDY, "rows": 1200})
    site.look_until(lambda status: status.pilots_running == 2)
    site.look_until_done(study, 0.1)
    cancelled, late = site.running()
    subprocess.run(["scancel", cancelled], check=True)
    site.look_until(lambda status: status.submitted == 3 and status.pilots_running == 2)
    site.look_until_done(study, 0.3)
    node = socket.gethostname().split(".")[0]
    control("update", f"NodeName={node}", "State=DRAIN", "Reason=test")
    try:
        # Out of time: Slurm itself ends it.
        control("update", f"JobId={late}", "TimeLimit=1")
        site.look_until(lambda status: status.pilots_waiting == 1)
        assert late not in site.keeper.jobs
    finally:
        control("update", f"NodeName={node}", "State=RESUME")
    site.look_until(lambda status: status.pilots_running == 2)
    finished(site, study)


@pytest.mark.parametrize("site", ["slurm"], indirect=True)
def test_what_slurm_refuses_is_said_in_its_words(site: Site) -> None:
    site.submit(STUDY)
    control("update", "PartitionName=day", "MaxTime=1")
    try:
        status = site.keeper.look(time.monotonic())
    finally:
        control("update", "PartitionName=day", "MaxTime=24:00:00")
    assert "time limit" in status.trouble.lower()
    assert (status.submitted, len(status.trouble.splitlines())) == (0, 1)
