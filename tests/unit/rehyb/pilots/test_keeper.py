"""Pilots come with work, go without it, and none works that nobody counts."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import httpx2
import pytest

from rehyb.durations import seconds
from rehyb.errors import FleetError
from rehyb.pilots.engines import JobState
from rehyb.pilots.job import ENVIRONMENT, JOB, TICKETS
from rehyb.pilots.keeper import SHORT_LIVES
from tests.testbed.batch import Site, ticket
from tests.testbed.command import Run

WAITING, RUNNING, ENDED = JobState.WAITING, JobState.RUNNING, JobState.ENDED


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path / "site")


def test_pilots_come_with_work_and_those_that_wait_go_with_it(site: Site) -> None:
    site.work = {"waiting": 8, "under_way": 0}
    status = site.keeper.look(0.0)
    assert (status.submitted, status.pilots_waiting) == (2, 2)
    starts = [command.split()[3] for command in site.batch.commands]
    assert starts == ["0", "0.2"], "they do not ask in the same moment"
    site.work = {"waiting": 0, "under_way": 0}
    assert site.keeper.look(1.0).pilots_waiting == 0
    assert set(site.batch.jobs.values()) == {ENDED}


def test_only_pilots_beyond_the_minimum_leave_when_idle(tmp_path: Path) -> None:
    site = Site(tmp_path, minimum=1)
    site.work = {"waiting": 8, "under_way": 0}
    site.keeper.look(0.0)
    standing, other = site.batch.commands
    assert "--max-idle" not in standing and other.endswith("--max-idle 60")


def test_a_worker_is_told_times_as_it_takes_them(tmp_path: Path) -> None:
    site = Site(tmp_path, walltime="20d", instance="0.1s", idle="30d")
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    script = (tmp_path / JOB).read_text()
    lifetime = script.partition("--lifetime ")[2].split()[0]
    assert seconds(lifetime, "lifetime") == 20 * 86400.0 - 30.0
    assert "--instance-seconds 0.1 " in script
    assert site.batch.commands[0].endswith("--max-idle 2592000")


def test_a_coordinator_that_is_away_changes_nothing(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    site.work = {}
    status = site.keeper.look(1.0)
    assert "no coordinator answers" in status.trouble
    assert (status.pilots_waiting, status.submitted) == (1, 1)


def test_a_batch_system_that_refuses_is_left_alone_for_a_while(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    site.batch.refuses = "AssocMaxSubmitJobLimit"
    assert "AssocMaxSubmitJobLimit" in site.keeper.look(0.0).trouble
    site.batch.refuses = ""
    still = site.keeper.look(1.0)
    assert still.submitted == 0 and "AssocMaxSubmitJobLimit" in still.trouble
    assert site.keeper.look(31.0).submitted == 1


def test_pilots_that_die_at_once_are_not_started_for_ever(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    with pytest.raises(FleetError, match="5 pilots in a row ended as soon as they began"):
        for second in range(100 * SHORT_LIVES):
            site.keeper.look(float(second))
            site.batch.jobs = dict.fromkeys(site.batch.jobs, ENDED)
    assert len(site.batch.jobs) == SHORT_LIVES


def test_none_is_started_for_what_pilots_cannot_take_and_what_to_do_is_one_sentence(
    site: Site,
) -> None:
    why = "study s is for workers tagged gpu (rehyb-worker --tags)"
    site.work = {"waiting": 0, "under_way": 0, "unfit": 8, "why": why}
    status = site.keeper.look(0.0)
    assert status.submitted == 0
    assert status.trouble == (
        f"no pilot is started for 8 more instances, which these pilots cannot take: {why}; "
        "change the pilots and start rehyb pilots again"
    )
    site.work |= {"waiting": 4}
    assert site.keeper.look(1.0).submitted == 1, "what they can take is not held up"


def test_the_coordinator_is_asked_for_what_the_workers_of_these_pilots_may_have(
    site: Site,
) -> None:
    site.keeper.look(0.0)
    (group,) = site.groups
    assert f"export REHYB_WORKER_GROUP={group}\n" in (site.keeper.folder / ENVIRONMENT).read_text()
    # They may be others now.
    site.keeper.prepare()
    site.keeper.look(1.0)
    assert len(site.groups) == 2


def test_draining_lets_those_that_run_finish_and_cancels_who_stays(site: Site) -> None:
    site.work = {"waiting": 8, "under_way": 0}
    site.keeper.look(0.0)
    site.run()
    site.keeper.look(1.0)
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        assert not site.tickets()
        if len(waits) == 5:
            site.batch.jobs["0"] = ENDED

    site.keeper.drain(wait, lambda _: None)
    assert sum(waits) == 150.0
    assert set(site.batch.jobs.values()) == {ENDED}


def test_the_next_keeper_of_a_folder_has_pilots_of_a_killed_one_leave(tmp_path: Path) -> None:
    for _ in range(2):
        site = Site(tmp_path)
        site.work = {"waiting": 4, "under_way": 0}
        site.keeper.look(0.0)
        assert site.tickets() == [ticket(site.batch.commands[0])]


def test_a_pilot_is_wanted_from_its_submission_until_it_is_counted_no_more(site: Site) -> None:
    site.work = {"waiting": 12, "under_way": 0}
    site.keeper.look(0.0)
    first, second, third = map(ticket, site.batch.commands)
    assert site.tickets() == sorted({first, second, third})
    site.batch.jobs["0"] = ENDED
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(1.0)
    assert site.tickets() == [second], "one ended, and the last to come was cancelled"


def test_a_pilot_that_the_batch_system_took_though_it_refused_is_not_wanted(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    site.batch.refuses = "Socket timed out on send/recv operation"
    site.keeper.look(0.0)
    assert len(site.batch.commands) == 1 and not site.tickets()
    site.batch.refuses = ""
    site.keeper.look(31.0)
    assert site.tickets() == [ticket(site.batch.commands[1])]


def test_a_folder_of_tickets_that_vanished_is_made_anew_for_those_that_wait(site: Site) -> None:
    site.work = {"waiting": 12, "under_way": 0}
    site.keeper.look(0.0)
    site.batch.jobs["0"] = RUNNING
    site.keeper.look(1.0)
    shutil.rmtree(site.keeper.folder / TICKETS)
    status = site.keeper.look(2.0)
    assert (status.trouble, status.submitted) == ("", 3)
    assert site.tickets() == sorted(map(ticket, site.batch.commands[1:]))
    # It has seen that it is not wanted, and leaves.
    site.batch.jobs["0"] = ENDED
    assert site.keeper.look(3.0).submitted == 4
    shutil.rmtree(site.keeper.folder / TICKETS)
    site.batch.jobs = dict.fromkeys(site.batch.jobs, ENDED)
    site.keeper.drain(lambda _: None, lambda _: None)


def test_without_its_folder_no_pilot_is_started_and_what_to_do_is_said(site: Site) -> None:
    site.work = {"waiting": 12, "under_way": 0}
    shutil.rmtree(site.keeper.folder)
    status = site.keeper.look(0.0)
    assert status.submitted == 0
    assert status.trouble.endswith("without which no pilot works: start rehyb pilots again")
    site.keeper.drain(lambda _: None, lambda _: None)


def test_a_batch_system_that_cancels_nothing_is_left_alone_for_a_while(site: Site) -> None:
    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    site.work, site.batch.refuses = {"waiting": 0, "under_way": 0}, "scancel: error"
    for second in range(1, 31):
        assert "scancel: error" in site.keeper.look(float(second)).trouble
    assert site.batch.cancels == 1
    with pytest.raises(FleetError, match="scancel: error"):
        site.keeper.drain(lambda _: None, lambda _: None)
    # At 0, 30, ... and 150 s, and at the end.
    assert site.batch.cancels == 1 + 6 + 1


def test_a_pilot_leaves_unless_its_keeper_wants_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "sleep").symlink_to("/bin/true")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    site = Site(tmp_path / "site", worker="touch worked; echo")

    def worked(ticket: str) -> bool:
        mark = site.keeper.folder / "worked"
        mark.unlink(missing_ok=True)
        job = ["sh", str(site.keeper.folder / JOB), ticket, "0"]
        assert subprocess.run(job, check=True, capture_output=True).stderr == b""
        return mark.exists()

    site.work = {"waiting": 4, "under_way": 0}
    site.keeper.look(0.0)
    mine = ticket(site.batch.commands[0])
    assert not worked("another")
    assert worked(mine)
    site.keeper.drain(lambda _: None, lambda _: None)
    assert not worked(mine)


def test_a_keeper_leaves_the_script_that_shells_read_as_it_is(tmp_path: Path) -> None:
    Site(tmp_path)
    with (tmp_path / JOB).open() as begun:
        script = begun.read()
        Site(tmp_path, cores=2)
        begun.seek(0)
        assert begun.read() == script != (tmp_path / JOB).read_text()


def test_the_folder_of_a_keeper_grows_with_no_start(tmp_path: Path) -> None:
    Site(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    for _ in range(3):
        Site(tmp_path).keeper.drain(lambda _: None, lambda _: None)
        Site(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_the_token_is_for_its_owners_eyes_only(site: Site) -> None:
    path = site.keeper.folder / "environment"
    assert path.stat().st_mode & 0o777 == 0o600
    assert "export REHYB_TOKEN=t\n" in path.read_text()
    assert "REHYB_TOKEN" not in (site.keeper.folder / JOB).read_text()


def test_a_status_is_one_line(site: Site) -> None:
    from rehyb.cli.operate.pilots import line

    site.work = {"waiting": 8, "under_way": 3}
    assert line(site.keeper.look(0.0)) == (
        "8 instances wait, 3 under way; pilots: 0 running, 3 queued, 3 wanted"
    )
    site.work = {"waiting": 1, "under_way": 0}
    assert line(site.keeper.look(0.0)).startswith("1 instance waits, 0 under way; ")


def test_a_coordinator_that_is_not_there_is_said_before_anything_is_started(
    run: Run, tmp_path: Path, talk_to: Callable[..., None]
) -> None:
    def refuse(request: httpx2.Request) -> httpx2.Response:
        raise httpx2.ConnectError("connection refused")

    talk_to(refuse)
    file = tmp_path / "site.toml"
    file.write_text('provider = "local"\nwalltime = "1h"\ncores = 1\nmaximum = 1\n')
    status, _, words = run("pilots", str(file))
    assert status == 1 and words.startswith("rehyb: no coordinator answers")
