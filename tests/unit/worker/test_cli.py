"""`rehyb-worker` says in one sentence what is wrong."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from worker.cli import _default_spool, _once_in_a_while, abilities, main


def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, str]:
    monkeypatch.setattr("sys.argv", ["rehyb-worker", *arguments])
    with pytest.raises(SystemExit) as leaving:
        main()
    assert isinstance(leaving.value.code, int)
    captured = capsys.readouterr()
    return leaving.value.code, captured.out + captured.err


def test_without_a_token_it_says_what_to_set(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("REHYB_TOKEN", raising=False)
    status, words = run(monkeypatch, capsys, "--url", "http://lab:9000")
    assert status == 1
    assert words.startswith("rehyb-worker: there is no token for http://lab:9000: set REHYB_TOKEN")


@pytest.mark.parametrize(
    "arguments", [("--processes", "0"), ("--batch", "none"), ("--instance-seconds", "0")]
)
def test_an_impossible_option_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, str]
) -> None:
    status, words = run(monkeypatch, capsys, *arguments)
    assert status == 2
    assert arguments[0] in words


def test_its_help_names_every_option(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status, words = run(monkeypatch, capsys, "--help")
    assert status == 0
    options = (
        "url token processes max-idle batch instance-seconds spool max-instances tags memory-mb "
        "lifetime"
    )
    assert all(f"--{option}" in words for option in options.split())


def test_results_for_different_coordinators_wait_in_different_folders(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    first, second = _default_spool("http://a:1"), _default_spool("http://b:1")
    assert first != second
    assert first == _default_spool("http://a:1")
    assert tmp_path in first.parents


@pytest.mark.parametrize(
    ("place", "why"), [("file", "File exists"), ("file/folder", "Not a directory")]
)
def test_a_spool_that_cannot_be_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    place: str,
    why: str,
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "t")
    (tmp_path / "file").touch()
    folder = tmp_path / place
    status, said = run(monkeypatch, capsys, "--spool", str(folder), "--processes", "1")
    assert status == 1
    assert said == (
        f"rehyb-worker: results cannot wait in {folder}: {why}; "
        "name with --spool a folder that is there or can be made\n"
    )


@pytest.mark.parametrize(
    ("lifetime", "words"),
    [("soon", "--lifetime is a time like 90s"), ("3s", "--lifetime 3s is too short: give it 10 s")],
)
def test_a_lifetime_that_cannot_be_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], lifetime: str, words: str
) -> None:
    status, said = run(monkeypatch, capsys, "--lifetime", lifetime)
    assert status == 1
    assert said.startswith(f"rehyb-worker: {words}")


@pytest.mark.parametrize("url", ["nonsense", "ftp://host", "http://", "http://host:port"])
def test_an_umbridge_server_at_no_address_is_refused_at_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], url: str
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "t")
    status, said = run(monkeypatch, capsys, "--umbridge", url, "--max-idle", "1")
    assert status == 1
    assert said.splitlines()[-1] == (
        f"rehyb-worker: --umbridge {url}: is no address of an UM-Bridge server: it begins with "
        "http:// or https://, and a host follows"
    )


def test_with_a_lifetime_none_of_its_connections_waits_beyond_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    agents: list[Any] = []
    monkeypatch.setattr("worker.cli.Agent.run", lambda agent: agents.append(agent))
    monkeypatch.setattr("signal.signal", lambda *_: None)
    # Else it simulates the nominal elbow first, in a process of its own.
    monkeypatch.setattr("worker.machine.canary", lambda: ("the same", 0.5, []))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    began = time.monotonic()
    assert run(monkeypatch, capsys, "--token", "t", "--lifetime", "10s")[0] == 0
    (agent,) = agents
    clients = agent.leases.client, agent.renewals.renew.args[0]
    assert clients[0] is not clients[1]
    assert all(began + 10.0 <= client.answer_by <= began + 60.0 for client in clients)


def test_signals_in_quick_succession_are_one() -> None:
    stops: list[int] = []
    handler = _once_in_a_while(lambda: stops.append(1))
    handler()
    handler()
    assert len(stops) == 1


def test_a_worker_says_in_one_sentence_what_it_can_do() -> None:
    jobs: Any = SimpleNamespace(bank=None)
    assert abilities(["awk@1", "noisy@2"], None, False) == (
        "evaluates models: rehyb's own, uploaded ones, awk@1, noisy@2; closes no loops without "
        "pip install 'rehyb[figures]'"
    )
    assert abilities([], None, True).endswith("uploaded ones; closes no loops with --lifetime")
    assert abilities([], jobs, False).endswith("; closes loops; interprets nothing: no bank")
    jobs.bank = ("f779", Path("bank.npz"))
    assert abilities([], jobs, False).endswith("; closes loops; interprets by bank f779")
