"""A real worker process against a real coordinator process, with real signals.

A child that is stopped with SIGSTOP stands for an instance that takes long: no code knows of it.
"""

import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from models.folder import read_folder
from rehyb.errors import WrongProtocol
from tests.testbed.coordinators.certificates import self_signed
from tests.testbed.fleet.bad_network import BadNetwork
from tests.testbed.fleet.lab import Lab, until
from tests.testbed.fleet.web_server import web_server
from tests.testbed.models import EXAMPLES
from worker.cli import SAME_SIGNAL_SECONDS

#: Enough instances that a worker is in the midst of them when it gets its signal.
STUDY = {"name": "many", "model": "ishigami", "method": "morris", "rows": 5000}


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    lab = Lab(tmp_path)
    yield lab
    lab.close()


def child_of(worker: subprocess.Popen[bytes]) -> int:
    """Return the process id of the child that evaluates."""
    found: list[int] = []

    def look() -> bool:
        children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text().split()
        for child in children:
            # One that was killed may end between the two looks.
            with suppress(FileNotFoundError, ProcessLookupError):
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    found.append(int(child))
        return bool(found)

    until(look)
    return found[0]


def hang_up(worker: subprocess.Popen[bytes]) -> int:
    """Stop the child that evaluates in the midst of an instance and return its process id."""
    child = child_of(worker)
    os.kill(child, signal.SIGSTOP)
    # It may have been between two instances; by now it has been given the next one.
    time.sleep(0.8)
    return child


def results_in(spool: Path) -> int:
    """Return how many results wait in the spool files of a folder."""
    waiting = 0
    for path in spool.glob("*.spool"):
        database = sqlite3.connect(path)
        waiting += database.execute("SELECT count(*) FROM results").fetchone()[0]
        database.close()
    return waiting


def test_a_worker_computes_a_study_and_leaves_when_there_is_no_more(lab: Lab) -> None:
    study = lab.client.submit({**STUDY, "rows": 50})["id"]
    worker = lab.start_worker("--max-idle", "0.5")
    assert worker.wait(30) == 0
    progress = lab.client.progress(study)
    assert (progress["state"], progress["ok"], progress["failed"]) == ("complete", 200, 0)
    assert not list((lab.folder / "spool").iterdir())
    (known,) = lab.client.workers()
    assert known["instances_done"] == 200
    assert {"mujoco", "numpy", "platform", "rehyb"} <= set(known["versions"])


def test_sigterm_finishes_what_runs_posts_it_and_releases_the_rest(lab: Lab) -> None:
    study = lab.client.submit(STUDY)["id"]
    worker = lab.start_worker("--batch", "1000")
    until(lambda: lab.client.progress(study)["ok"] > 0)
    child = hang_up(worker)
    worker.send_signal(signal.SIGTERM)
    with pytest.raises(subprocess.TimeoutExpired):
        worker.wait(1.0)
    os.kill(child, signal.SIGCONT)
    assert worker.wait(20) == 0
    progress = lab.client.progress(study)
    assert progress["leased"] == 0
    assert 0 < progress["ok"] < progress["instances"]
    assert not list((lab.folder / "spool").iterdir())


def test_a_second_sigterm_releases_at_once(lab: Lab) -> None:
    study = lab.client.submit(STUDY)["id"]
    worker = lab.start_worker("--batch", "1000")
    until(lambda: lab.client.progress(study)["ok"] > 0)
    hang_up(worker)
    worker.send_signal(signal.SIGTERM)
    # Handled late, the first would be half a second before the second, and both count as one.
    time.sleep(4 * SAME_SIGNAL_SECONDS)
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(5) == 0
    assert lab.client.progress(study)["leased"] == 0


def test_a_killed_child_and_a_hung_child_cost_an_attempt_but_no_instance(lab: Lab) -> None:
    study = lab.client.submit({**STUDY, "rows": 1000})["id"]
    worker = lab.start_worker("--batch", "100", "--instance-seconds", "1", "--max-idle", "1")
    until(lambda: lab.client.progress(study)["ok"] > 0)
    os.kill(child_of(worker), signal.SIGKILL)
    held = lab.client.progress(study)["leased"]
    # The results of the first child may come when the second one still loads its model, for which
    # it has longer than for an instance.
    before = lab.client.progress(study)["ok"]
    until(lambda: lab.client.progress(study)["ok"] > before + held)
    os.kill(child_of(worker), signal.SIGSTOP)
    assert worker.wait(30) == 0
    progress = lab.client.progress(study)
    assert (progress["state"], progress["ok"], progress["failed"]) == ("complete", 4000, 0)


def test_results_wait_on_disk_while_the_coordinator_is_away_and_are_posted_later(lab: Lab) -> None:
    study = lab.client.submit(STUDY)["id"]
    worker = lab.start_worker("--batch", "1000")
    until(lambda: lab.client.progress(study)["ok"] > 0)
    child = hang_up(worker)
    lab.coordinator.kill()
    lab.coordinator.wait()
    os.kill(child, signal.SIGCONT)
    # What it has leased it goes on computing.
    time.sleep(1.0)
    for _ in range(2):
        worker.send_signal(signal.SIGTERM)
        time.sleep(0.3)
    assert worker.wait(15) == 0
    waiting = results_in(lab.folder / "spool")
    assert waiting > 0

    lab.start_coordinator()
    before = lab.client.progress(study)["ok"]
    heir = lab.start_worker("--batch", "10")
    until(lambda: lab.client.progress(study)["ok"] >= before + waiting)
    heir.send_signal(signal.SIGTERM)
    assert heir.wait(20) == 0
    by_worker = {known["id"]: known["instances_done"] for known in lab.client.workers()}
    first = next(done for name, done in by_worker.items() if f"-{worker.pid}-" in name)
    assert first >= waiting


def test_a_worker_waits_for_a_coordinator_that_is_not_there_yet_and_outlasts_its_restart(
    lab: Lab,
) -> None:
    lab.coordinator.terminate()
    assert lab.coordinator.wait(20) == 0
    # Of a model whose code it has it tells the coordinator first.
    worker = lab.start_worker("--batch", "50", "--models", str(EXAMPLES / "ishigami_awk"))
    log = lab.folder / f"worker-{len(lab.processes) - 1}.log"
    until(lambda: "; trying again until one answers" in log.read_text())
    time.sleep(1.0)
    assert worker.poll() is None
    lab.start_coordinator()
    until(lambda: "ishigami_awk" in {model["name"] for model in lab.client.models()})
    assert log.read_text().count("trying again") == 1
    study = lab.client.submit({**STUDY, "rows": 500})["id"]
    until(lambda: lab.client.progress(study)["ok"] > 0)
    lab.coordinator.kill()
    lab.coordinator.wait()
    lab.start_coordinator()
    # A lease that was granted as it was killed reached nobody, and ends after its minute.
    until(lambda: lab.client.progress(study)["state"] == "complete", 90.0)
    assert lab.client.progress(study)["ok"] == 2000
    worker.terminate()
    assert worker.wait(20) == 0


def test_a_worker_that_has_no_model_that_is_wanted_says_what_it_has_and_what_is_missing(
    lab: Lab,
) -> None:
    described = read_folder(EXAMPLES / "ishigami_awk").description
    lab.client.announce_model(described.as_json())
    study = lab.client.submit({**STUDY, "model": "ishigami_awk", "rows": 4})["id"]
    lab.start_worker("--max-idle", "1")
    log = lab.folder / "worker-1.log"
    missing = f"takes nothing of studies of {described.version}: its code is not here; whoever has"
    until(lambda: f"{missing} it names it with --models DIR" in log.read_text())
    assert " evaluates models: rehyb's own, uploaded ones; closes loops; " in log.read_text()
    assert lab.client.progress(study)["waits_for"] == described.version


def test_posts_that_take_longer_than_a_lease_lose_no_instance(tmp_path: Path) -> None:
    lab = Lab(tmp_path, REHYB_LEASE_SECONDS="2")
    network = BadNetwork([lab.port], seed=1, trouble=0.0, slow={"/v1/results": 3.0})
    try:
        study = lab.client.submit({**STUDY, "rows": 5})["id"]
        lab.start_worker("--url", network.url)
        until(lambda: lab.client.progress(study)["state"] == "complete", 60.0)
        found = lab.client.all_instances(study)
        assert [one["attempts"] for one in found] == [{}] * 20
    finally:
        network.close()
        lab.close()


def test_a_web_server_in_the_place_of_a_coordinator_that_is_away_costs_neither_worker_nor_result(
    lab: Lab,
) -> None:
    study = lab.client.submit({**STUDY, "rows": 1000})["id"]
    worker = lab.start_worker("--batch", "50")
    until(lambda: lab.client.progress(study)["ok"] > 100)
    lab.coordinator.kill()
    lab.coordinator.wait()
    with web_server(lab.port, [404, 302, 403, 400, 401, 405, 520, 200]) as answered:
        until(lambda: len(answered) > 6)
    lab.start_coordinator()
    until(lambda: lab.client.progress(study)["state"] == "complete", 60.0)
    assert worker.poll() is None
    log = (lab.folder / "worker-1.log").read_text()
    assert "cannot use" not in log and "not taken" not in log
    attempts = [one["attempts"] for one in lab.client.all_instances(study)]
    assert all(own.keys() <= {"unheard"} for own in attempts)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--token", "wrong"), "token"),
        (("--url", "https://127.0.0.1:{port}"), "does not speak TLS: write http://127.0.0.1:"),
        (("--url", "127.0.0.1:{port}"), "is not a coordinator's address: it begins with http://"),
    ],
)
def test_what_waiting_does_not_mend_ends_a_worker_at_its_start_in_one_sentence(
    lab: Lab, option: tuple[str, str], words: str
) -> None:
    worker = lab.start_worker(option[0], option[1].format(port=lab.port))
    assert worker.wait(20) == 1
    log = (lab.folder / "worker-1.log").read_text()
    assert "Traceback" not in log
    last = log.splitlines()[-1]
    assert last.startswith("rehyb-worker: ") and words in last


def test_another_server_that_speaks_json_ends_a_worker_at_its_start_in_one_sentence(
    lab: Lab,
) -> None:
    lab.coordinator.kill()
    lab.coordinator.wait()
    with web_server(lab.port, [200], b'{"models": 1}'):
        assert lab.start_worker().wait(20) == 1
    log = (lab.folder / "worker-1.log").read_text()
    assert "Traceback" not in log
    assert log.splitlines()[-1] == (
        f"rehyb-worker: http://127.0.0.1:{lab.port} answers, but is no coordinator of rehyb; "
        "set REHYB_URL to its address"
    )


def test_who_asks_a_coordinator_with_a_certificate_without_tls_is_told_what_to_write(
    tmp_path: Path,
) -> None:
    certificate, key = self_signed(tmp_path, "127.0.0.1")
    lab = Lab(tmp_path, REHYB_TLS_CERTIFICATE=str(certificate), REHYB_TLS_KEY=str(key))
    there = f"127.0.0.1:{lab.port}"
    said = f"no coordinator answers at http://{there}: what listens there speaks TLS: write https"
    try:
        with pytest.raises(WrongProtocol, match=f"^{said}://{there}$"):
            lab.client.studies()
        worker = lab.start_worker("--url", f"http://{there}")
        assert worker.wait(20) == 1
        last = (tmp_path / "worker-1.log").read_text().splitlines()[-1]
        assert last == f"rehyb-worker: {said}://{there}"
    finally:
        lab.close()
