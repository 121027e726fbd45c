"""`rehyb coordinator` waits for PostgreSQL, at its start and later, and says so once."""

import re
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx2
import pytest
import sqlalchemy as sa

from tests.testbed.coordinators.cable import Cable
from tests.testbed.coordinators.postgresql import Server, serving
from tests.testbed.coordinators.service import PATIENCE_SECONDS, Service, running
from tests.testbed.fleet.lab import Lab, until

SETTINGS = {"REHYB_TOKEN": "t", "REHYB_PORT": "0"}
STUDY = {"name": "s", "model": "ishigami", "method": "morris", "rows": 3000}


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """A PostgreSQL server that may be killed."""
    with serving(("autovacuum=off",)) as server:
        yield server


def listening(coordinator: Service) -> str:
    """Return where a coordinator listens, once it does."""
    found = re.fullmatch(r"listening on (\S+)\n", coordinator.said())
    assert found is not None
    return found[1]


def test_a_coordinator_waits_for_a_server_that_starts_after_it(server: Server) -> None:
    url = server.database("later")
    with ExitStack() as stack:
        with server.away():
            coordinator = stack.enter_context(running("coordinator", url, **SETTINGS))
            said = coordinator.said()
            assert "is away, and waited for: its server does not answer" in said
        assert "the database is back" in coordinator.said()
        assert httpx2.get(f"{listening(coordinator)}/readyz", trust_env=False).status_code == 200
        assert coordinator.stop() == 0
        assert coordinator.is_silent()


def test_a_coordinator_that_is_stopped_while_it_waits_ends_without_an_error(server: Server) -> None:
    with server.away(), running("coordinator", server.url, **SETTINGS) as coordinator:
        assert "waited for" in coordinator.said()
        assert coordinator.stop() == 0
        assert coordinator.is_silent()


# The first looks whether anybody is there; the second is of who looks for damage, the fourth of who
# opens the database to serve.
@pytest.mark.parametrize(("place", "away"), [(2, True), (4, True), (4, False)])
def test_a_server_that_goes_while_a_coordinator_starts_is_waited_for_in_one_line(
    server: Server, place: int, away: bool
) -> None:
    went = threading.Event()

    def cut_at(number: int) -> None:
        if number == place:
            cable.cut()
            went.set()
            if not away:
                cable.mend()

    cable = Cable(server.database(f"goes_{place}_{int(away)}"), cut_at)
    try:
        with running("coordinator", cable.url, **SETTINGS) as coordinator:
            assert went.wait(PATIENCE_SECONDS)
            if away:
                assert "is away, and waited for: its server does not answer" in coordinator.said()
                cable.mend()
                assert "the database is back" in coordinator.said()
            assert httpx2.get(f"{listening(coordinator)}/readyz", trust_env=False).is_success
            assert coordinator.stop() == 0
            assert coordinator.is_silent()
    finally:
        cable.close()


def test_a_coordinator_waits_for_a_server_that_only_reads_as_a_standby_does(server: Server) -> None:
    url = server.database("standby")
    admin = sa.create_engine(server.url, isolation_level="AUTOCOMMIT")
    only_read = "ALTER DATABASE standby SET default_transaction_read_only = "
    with running("coordinator", url, **SETTINGS) as first:
        listening(first)
    with admin.connect() as connection:
        connection.exec_driver_sql(only_read + "on")
        with running("coordinator", url, **SETTINGS) as coordinator:
            assert "is away, and waited for: its server takes no writes" in coordinator.said()
            connection.exec_driver_sql(only_read + "off")
            assert "the database is back" in coordinator.said()
            listening(coordinator)
    admin.dispose()


def test_rehyb_up_says_what_its_coordinator_waits_for_and_goes_on_with_it(
    server: Server, tmp_path: Path
) -> None:
    options = ("--directory", str(tmp_path), "--port", "0", "--workers", "0")
    with ExitStack() as stack:
        with server.away():
            up = stack.enter_context(running("up", server.url, *options))
            assert up.said() == (
                "the database is away, and waited for: its server does not answer; Ctrl-C gives "
                "up\n"
            )
            assert up.is_silent()
        assert up.said().startswith("The coordinator listens on http://127.0.0.1:")
        assert up.stop() == 130


def test_what_waiting_does_not_mend_ends_a_coordinator_at_its_start(server: Server) -> None:
    for url, words in (
        (server.url.replace("/postgres", "/elsewhere"), 'database "elsewhere" does not exist'),
        (server.url.replace("rehyb@", "nobody@"), 'role "nobody" does not exist'),
    ):
        with running("coordinator", url, **SETTINGS) as coordinator:
            assert coordinator.ended() == 1
            said = coordinator.said()
            assert said.startswith("rehyb: the database cannot be used: ") and words in said
            assert coordinator.is_silent()


def test_while_the_server_is_away_all_are_told_to_wait_the_log_says_it_once_and_nothing_is_lost(
    server: Server, tmp_path: Path
) -> None:
    url = server.database("away")
    lab = Lab(tmp_path, REHYB_DATABASE_URL=url, REHYB_LEASE_SECONDS="4")
    log = tmp_path / "coordinator-0.log"
    try:
        study = lab.client.submit(STUDY)["id"]
        lab.start_worker("--batch", "100")
        until(lambda: lab.client.progress(study)["ok"] > 100)
        mine = {"Authorization": f"Bearer {lab.environment['REHYB_TOKEN']}"}
        there = httpx2.Client(base_url=lab.client.url, trust_env=False, timeout=60.0)
        with there, there.stream("GET", f"/v1/studies/{study}/events", headers=mine) as events:
            with server.away():
                until(lambda: "database is away" in log.read_text())
                for path, token in (
                    ("/readyz", mine),
                    ("/metrics", mine),
                    (f"/v1/studies/{study}/progress", mine),
                    # Of whom nobody knows who they are.
                    ("/v1/studies", {"Authorization": "Bearer another"}),
                ):
                    answer = there.get(path, headers=token)
                    assert (answer.status_code, answer.headers["Retry-After"]) == (503, "2"), path
            # It goes on where it was.
            assert any('"state": "complete"' in line for line in events.iter_lines())
        assert lab.client.progress(study)["ok"] == 12_000
        # An answer that granted leases may have been lost with the server: nothing was tried.
        attempts = [one["attempts"] for one in lab.client.all_instances(study)]
        heard = [own for own in attempts if not own.keys() <= {"unheard"}]
        assert len(attempts) == 12_000 and not heard, (heard[:3], log.read_text())
        _, *said = log.read_text().splitlines()
        assert "the database is away" in said[0] and "the database is back" in said[1]
        # Such leases end, which is said as of any other.
        unheard = "instances came back" if any(attempts) else "nobody could renew a lease"
        more = [
            line
            for line in said[2:]
            if "nobody could renew a lease" not in line and unheard not in line
        ]
        assert not more, more
    finally:
        lab.close()
