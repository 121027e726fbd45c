"""No more pilots work than `maximum`, whatever a list of jobs lacks and whoever was killed."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from rehyb.pilots.engines import JobState
from rehyb.pilots.job import JOB, MARKS, TICKETS
from rehyb.pilots.keeper import MISSING_SECONDS
from rehyb.pilots.marks import STALE_SECONDS
from tests.testbed.batch import Site, ticket

RUNNING, MISSING, ENDED = JobState.RUNNING, JobState.MISSING, JobState.ENDED


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path / "site")


def begin(site: Site, *numbers: int) -> list[Path]:
    """Have pilots begin, as the script does it, and return their marks."""
    marks = []
    for number in numbers:
        site.batch.jobs[str(number)] = RUNNING
        mark = site.keeper.folder / MARKS / ticket(site.batch.commands[number])
        mark.touch()
        marks.append(mark)
    return marks


def touch(mark: Path) -> None:
    """Touch a file as a pilot does seconds later."""
    later = mark.stat().st_mtime_ns + 10**9
    os.utime(mark, ns=(later, later))


def full(site: Site) -> list[Path]:
    """Have as many pilots as may be at work."""
    site.work = {"waiting": 100, "under_way": 0}
    assert site.keeper.look(0.0).submitted == 3
    marks = begin(site, 0, 1, 2)
    assert site.keeper.look(1.0).pilots_running == 3
    return marks


def test_pilots_that_a_list_lacks_are_counted_as_long_as_they_touch_their_marks(
    site: Site,
) -> None:
    marks = full(site)
    site.batch.jobs = dict.fromkeys(site.batch.jobs, MISSING)
    for second in range(10, 1000, 10):
        for mark in marks:
            touch(mark)
        status = site.keeper.look(float(second))
        assert (status.submitted, status.pilots_running) == (3, 3)
    assert len(site.tickets()) == 3, "nothing made them leave"


def test_jobs_that_one_answer_lacks_keep_their_places_in_the_queue(site: Site) -> None:
    site.work = {"waiting": 100, "under_way": 0}
    site.keeper.look(0.0)
    before = site.tickets()
    queued, site.batch.jobs = site.batch.jobs, dict.fromkeys(site.batch.jobs, MISSING)
    site.keeper.look(1.0)
    site.batch.jobs = queued
    status = site.keeper.look(MISSING_SECONDS + 2.0)
    assert (status.submitted, status.pilots_waiting) == (3, 3)
    # Each time anew: lists may lack them now and then.
    site.batch.jobs = dict.fromkeys(site.batch.jobs, MISSING)
    assert site.keeper.look(MISSING_SECONDS + 3.0).submitted == 3
    assert site.tickets() == before


def test_a_job_that_vanished_blocks_its_place_for_no_more_than_a_minute_or_two(
    site: Site,
) -> None:
    full(site)
    site.batch.jobs["0"] = MISSING
    assert site.keeper.look(10.0).submitted == 3
    status = site.keeper.look(1.0 + STALE_SECONDS)
    assert status.submitted == 4, "killed: its mark is touched no more"
    assert status.pilots_leaving == 0
    site.batch.jobs["3"] = MISSING
    site.keeper.look(200.0)
    assert site.keeper.look(200.0 + MISSING_SECONDS).submitted == 5, "cancelled in the queue"


def test_who_leaves_by_itself_and_who_was_surely_ended_makes_room_at_once(site: Site) -> None:
    first, second, _ = full(site)
    site.batch.jobs["0"] = MISSING
    first.unlink()
    assert site.keeper.look(2.0).submitted == 4
    # Gone before anybody saw its mark: it took its ticket away.
    site.batch.jobs["3"] = MISSING
    (site.keeper.folder / TICKETS / ticket(site.batch.commands[3])).unlink()
    assert site.keeper.look(3.0).submitted == 5
    site.batch.jobs["1"] = ENDED
    assert site.keeper.look(4.0).submitted == 6
    assert not second.exists()


def test_the_next_keeper_counts_pilots_of_a_killed_one_until_they_have_left(
    tmp_path: Path,
) -> None:
    first, second, third = full(Site(tmp_path))
    site = Site(tmp_path)
    site.work = {"waiting": 100, "under_way": 0}
    status = site.keeper.look(0.0)
    assert (status.submitted, status.pilots_leaving) == (0, 3)
    assert not site.tickets(), "they may be other pilots than these: they finish and leave"
    first.unlink()
    status = site.keeper.look(1.0)
    assert (status.submitted, status.pilots_leaving) == (1, 2)
    touch(second)
    site.keeper.look(50.0)
    # The third was killed with its keeper.
    assert site.keeper.look(STALE_SECONDS).submitted == 2
    assert second.exists() and not third.exists()


def test_a_pilot_that_began_as_it_was_cancelled_is_counted_until_it_has_left(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    (mark,) = begin(site, 0)
    site.batch.jobs["0"] = JobState.WAITING
    site.work = {"waiting": 0, "under_way": 0}
    site.keeper.look(1.0)
    site.work = {"waiting": 100, "under_way": 0}
    status = site.keeper.look(2.0)
    assert (status.pilots_leaving, status.pilots_waiting) == (1, 2)
    mark.unlink()
    assert site.keeper.look(3.0).pilots_waiting == 3


def test_a_pilot_that_stood_still_counts_again_when_it_goes_on(site: Site) -> None:
    (mark, *_) = full(site)
    site.batch.jobs["0"] = MISSING
    site.keeper.look(10.0)
    assert site.keeper.look(200.0).submitted == 4
    mark.touch()
    assert site.keeper.look(201.0).pilots_leaving == 1


def test_a_folder_that_is_away_for_a_moment_makes_nobody_believe_that_pilots_left(
    site: Site,
) -> None:
    full(site)
    marks = site.keeper.folder / MARKS
    marks.rename(marks.with_name("away"))
    site.batch.jobs = dict.fromkeys(site.batch.jobs, MISSING)
    status = site.keeper.look(2.0)
    assert (status.submitted, status.pilots_running) == (3, 3)


@pytest.fixture
def short_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have scripts sleep for a hundredth of a second instead of one."""
    sleep = tmp_path / "bin" / "sleep"
    sleep.parent.mkdir()
    sleep.write_text("#!/bin/sh\nexec /bin/sleep 0.01\n")
    sleep.chmod(0o755)
    monkeypatch.setenv("PATH", f"{sleep.parent}:{os.environ['PATH']}")


def until(path: Path, *, there: bool = True) -> None:
    deadline = time.monotonic() + 10.0
    while path.exists() != there:
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture
def slow(tmp_path: Path) -> Site:
    """A site with one pilot, whose worker takes its time to leave, as one does with an instance."""
    worker = tmp_path / "worker"
    worker.write_text(
        "#!/bin/sh\ntrap 'touch told' TERM\ntouch began\n"
        "until [ -e told ] && [ -e enough ]; do /bin/sleep 0.01; done\ntouch left\n"
    )
    worker.chmod(0o755)
    site = Site(tmp_path / "site", worker=str(worker))
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    return site


@pytest.mark.usefixtures("short_seconds")
def test_a_pilot_touches_its_mark_as_long_as_its_worker_runs_also_while_it_leaves(
    slow: Site,
) -> None:
    site = slow
    name, folder = ticket(site.batch.commands[0]), site.keeper.folder
    mark = folder / MARKS / name
    with subprocess.Popen(["sh", str(folder / JOB), name, "0"]) as job:
        until(folder / "began")
        job.terminate()
        until(folder / "told")
        for _ in range(2):
            mark.unlink()
            until(mark)
        (folder / "enough").touch()
    assert not mark.exists()
    assert site.tickets() == [name], "a batch system may queue again what it ended"


@pytest.mark.usefixtures("short_seconds")
def test_a_pilot_whose_worker_ends_by_itself_takes_mark_and_ticket_away(tmp_path: Path) -> None:
    site = Site(tmp_path / "site", worker="false")
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    name = ticket(site.batch.commands[0])
    job = subprocess.run(["sh", str(site.keeper.folder / JOB), name, "0"], check=False)
    assert job.returncode == 1, "what its worker says is what the batch system hears"
    assert not site.tickets()
    assert not list((site.keeper.folder / MARKS).iterdir())


@pytest.mark.usefixtures("short_seconds")
def test_the_worker_of_a_pilot_whose_shell_is_killed_leaves_and_counts_until_it_has(
    slow: Site,
) -> None:
    name, folder = ticket(slow.batch.commands[0]), slow.keeper.folder
    mark = folder / MARKS / name
    with subprocess.Popen(["sh", str(folder / JOB), name, "0"]) as job:
        until(folder / "began")
        job.kill()
    until(folder / "told")
    for _ in range(2):
        # As whoever is told by the batch system that the job has ended.
        mark.unlink(missing_ok=True)
        until(mark)
    assert not (folder / "left").exists()
    (folder / "enough").touch()
    until(mark, there=False)
    assert (folder / "left").exists()
