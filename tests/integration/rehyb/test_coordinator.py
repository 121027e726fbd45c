"""`rehyb coordinator` waits for PostgreSQL, at its start and later, and says so once."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx2
import pytest

from tests.testbed.coordinators.postgresql import Server, serving
from tests.testbed.coordinators.service import Service, running
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
        assert len(attempts) == 12_000 and all(own.keys() <= {"unheard"} for own in attempts)
        _, *said = log.read_text().splitlines()
        assert "the database is away" in said[0] and "the database is back" in said[1]
        assert all("nobody could renew a lease" in line for line in said[2:])
    finally:
        lab.close()
