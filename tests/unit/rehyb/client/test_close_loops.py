"""Closing the loop through a coordinator leaves what the command line itself would have left."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import pytest
from typer.testing import CliRunner

from analysis.closeloop.contract import REPORT_FILES
from rehyb import Client, Invalid, RehybError
from rehyb.cli import app
from rehyb.client.close_loops import close_loop_by_worker, interpret_by_worker
from rehyb.client.packing import packed
from tests.testbed.transport import CoordinatorTransport

REPORT = {"schema": 1, "verdict": "adequate", "x": 0.1 + 0.2}


class Coordinator:
    """As much of a coordinator as somebody with a session sees."""

    def __init__(self, *standings: dict[str, Any], refusal: dict[str, Any] | None = None) -> None:
        self.standings = list(standings)
        self.refusal = refusal
        self.archive = b""
        self.name = ""

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if path == "/v1/sessions":
            self.archive, self.name = request.read(), request.url.params["name"]
            assert request.headers["content-type"] == "application/zip"
            if self.refusal:
                return httpx2.Response(422, json=self.refusal)
            return httpx2.Response(201, json={"id": "s"})
        if path == "/v1/sessions/s/close-loop":
            return httpx2.Response(202, json={"id": "j"})
        name = path.rsplit("/", 1)[-1]
        if name in REPORT_FILES:
            text = json.dumps(REPORT) if name == "report.json" else f"<{name}>"
            return httpx2.Response(200, text=text)
        assert path == "/v1/close-loops/j"
        standing = self.standings.pop(0)
        return httpx2.Response(200, json={"progress": "", **standing})


def client(coordinator: Callable[[httpx2.Request], httpx2.Response]) -> Client:
    return Client("http://c", "t", transport=CoordinatorTransport(coordinator))


def close_loop(
    coordinator: Coordinator, session: Path, out: Path, told: Callable[[str], None] = print
) -> dict[str, Any]:
    return close_loop_by_worker(client(coordinator), session, out, told, sleep=lambda seconds: None)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "monday: 10"
    (folder / "fast").mkdir(parents=True)
    (folder / "session.json").write_text("{}")
    (folder / "fast" / "a.csv").write_text("time\n")
    (folder / ".DS_Store").write_text("not ours")
    return folder


def test_a_report_is_followed_and_its_four_files_fetched(session: Path, tmp_path: Path) -> None:
    coordinator = Coordinator(
        {"state": "waiting", "note": "no worker is at work"},
        {"state": "waiting", "note": "no worker is at work"},
        {"state": "running", "progress": "tracing"},
        {"state": "done", **REPORT},
    )
    told: list[str] = []
    report = close_loop(coordinator, session, tmp_path / "new" / "out", told.append)
    assert report == REPORT
    assert told == ["uploading", "no worker is at work", "tracing"]
    out = tmp_path / "new" / "out"
    assert sorted(path.name for path in out.iterdir()) == sorted(REPORT_FILES)
    assert json.loads((out / "report.json").read_text()) == REPORT
    assert (coordinator.name, coordinator.archive[:2]) == ("monday_ 10", b"PK")


@pytest.mark.parametrize(("status", "kind"), [(422, Invalid), (500, RehybError)])
def test_a_job_that_failed_is_its_sentence_and_leaves_nothing(
    session: Path, tmp_path: Path, status: int, kind: type[RehybError]
) -> None:
    problem = {"status": status, "detail": "a.csv, line 3: no"}
    coordinator = Coordinator({"state": "failed", "problem": problem})
    with pytest.raises(RehybError, match=r"^a\.csv, line 3: no$") as caught:
        close_loop(coordinator, session, tmp_path / "out")
    assert type(caught.value) is kind
    assert not (tmp_path / "out").exists()


def test_a_session_that_is_refused_is_invalid_in_the_coordinator_s_words(
    session: Path, tmp_path: Path
) -> None:
    refusal = {"detail": "a.csv, column time, line 1: is missing", "file": "a.csv", "line": 1}
    with pytest.raises(Invalid, match=r"^a\.csv, column time, line 1: is missing$"):
        close_loop(Coordinator(refusal=refusal), session, tmp_path / "out")


def test_a_file_in_place_of_the_folder_is_found_before_anything_is_sent(
    session: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").write_text("mine")
    coordinator = Coordinator()
    with pytest.raises(NotADirectoryError):
        close_loop(coordinator, session, tmp_path / "out")
    assert not coordinator.archive


def test_equal_folders_make_equal_archives(session: Path, tmp_path: Path) -> None:
    other = tmp_path / "elsewhere" / session.name
    (other / "fast").mkdir(parents=True)
    (other / "fast" / "a.csv").write_text("time\n")
    (other / "session.json").write_text("{}")
    with packed(session) as one, packed(other) as two:
        assert one.read_bytes() == two.read_bytes()
        with zipfile.ZipFile(one) as archive:
            assert archive.namelist() == ["monday_ 10/fast/a.csv", "monday_ 10/session.json"]
    assert not one.exists()


def test_a_link_stays_in_the_folder_or_stays_a_link(session: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    (session / "b.csv").symlink_to("fast/a.csv")
    (session / "c.csv").symlink_to("../secret")
    with packed(session) as path, zipfile.ZipFile(path) as archive:
        assert archive.read("monday_ 10/b.csv") == b"time\n"
        assert archive.read("monday_ 10/c.csv") == b"../secret"
        assert archive.getinfo("monday_ 10/c.csv").external_attr >> 16 == 0o120777


def test_a_zip_file_goes_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "s.zip").write_bytes(b"PK1")
    with packed(tmp_path / "s.zip") as path:
        assert path == tmp_path / "s.zip"


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="no such folder"), packed(tmp_path / "nowhere"):
        pass


def test_a_coordinator_without_submit_is_a_mistake_to_be_told(
    session: Path, tmp_path: Path
) -> None:
    options = ["--out", str(tmp_path / "out"), "--url", "http://c"]
    ran = CliRunner().invoke(app, ["close-loop", str(session), *options])
    assert "--submit" in str(ran.exception)


def test_a_simulated_recording_is_not_for_a_worker_and_is_not_sent(tmp_path: Path) -> None:
    recording = tmp_path / "patient.npz"
    recording.write_bytes(b"PK")
    coordinator = Coordinator()
    with pytest.raises(Invalid, match=r"patient\.npz: a worker interprets a measured session"):
        interpret_by_worker(client(coordinator), recording)
    assert not coordinator.archive


def test_who_waits_for_an_interpretation_is_told_why(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def waits(*_: object, progress: Callable[[str], None], **__: object) -> None:
        progress("no worker with the bank for it is at work")
        raise RehybError("enough")

    monkeypatch.setattr("rehyb.cli.interpretation.interpret_by_worker", waits)
    result = CliRunner().invoke(app, ["interpret", str(session), "--submit", "--token", "t"])
    assert "no worker with the bank for it is at work" in result.stderr
    assert result.stdout == ""
