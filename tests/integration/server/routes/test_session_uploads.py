"""Real sessions and real bad ones, uploaded to a coordinator that looks at them in a process."""

import asyncio
import re
import stat
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from server import sandbox
from server.app import create_app
from server.settings import Settings
from server.store.database.engine import reading
from server.store.database.schema import session_parts, sessions
from tests.testbed.sessions.bad import BAD, linked, words
from tests.testbed.sessions.small import HEADER, Folder, rows

TOKEN = "sessions"
#: What is refused before and after MuJoCo has a look, one of each kind. The unit tests try all of
#: them on the reader itself; here each costs a process.
SAMPLE = (
    "no session.json",
    "brackets without end",
    "a model of half a letter",
    "a body whose inertia only a mesh has",
    "bodies nested to death",
    "time that stands still",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A session that is right until a test spoils it."""
    path = tmp_path / "session"
    path.mkdir()
    return Folder(path).write()


@pytest.fixture
def app(upgraded_sqlite: str) -> FastAPI:
    return create_app(Settings(database_url=upgraded_sqlite, token=SecretStr(TOKEN)))


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, headers={"Authorization": f"Bearer {TOKEN}"}) as client:
        yield client


def zipped(folder: Path) -> bytes:
    """Pack a session's folder; links stay links."""
    file = folder.with_suffix(".zip")
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in sorted(folder.iterdir()):
            member = zipfile.ZipInfo(path.name)
            if path.is_symlink():
                member.external_attr = (stat.S_IFLNK | 0o777) << 16
                packed.writestr(member, str(path.readlink()))
            else:
                packed.write(path, path.name)
    return file.read_bytes()


def upload(client: TestClient, content: bytes, name: str = "session") -> Any:
    headers = {"Content-Type": "application/zip"}
    return client.post(f"/v1/sessions?name={name}", content=content, headers=headers)


def is_refused(client: TestClient, content: bytes) -> dict[str, Any]:
    """Upload what cannot be analysed; returns the problem, of which nothing else is left."""
    answer = upload(client, content)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    app: Any = client.app
    with reading(app.state.engine) as connection:
        for table in (sessions, session_parts):
            assert connection.scalar(sa.select(sa.func.count()).select_from(table)) == 0
    problem: dict[str, Any] = answer.json()
    return problem


def spoilt(folder: Path, *, column: int, change: Any) -> None:
    """Write the trial anew with one column changed."""
    table = rows()
    table[:, column] = change(table[:, column])
    lines = [",".join(f"{x:.7g}" for x in row) for row in table]
    (folder / "a.csv").write_text("\n".join([HEADER, *lines]) + "\n")


def test_a_session_is_understood(client: TestClient, folder: Path) -> None:
    kept = upload(client, zipped(folder)).json()
    assert kept["model"] == "device.xml"
    assert kept["declared_effects"] == [{"effect": "viscoelastic_joint", "joint": "elbow"}]
    assert kept["analysed_joints"] == ["elbow"]
    (trial,) = kept["trials"]
    assert trial["seconds"] == pytest.approx(1999 / 200)
    assert (trial["file"], trial["role"], trial["group"]) == ("a.csv", "fit", "a.csv")
    assert trial["joints"] == ["shoulder", "elbow"]


@pytest.mark.parametrize("what", SAMPLE)
def test_a_bad_session_is_refused_in_the_command_line_s_words(
    client: TestClient, folder: Path, what: str
) -> None:
    BAD[what][0](folder)
    if what == "no session.json":
        assert "session.zip: holds no session.json" in is_refused(client, zipped(folder))["detail"]
        return
    with pytest.raises(SessionError) as caught:
        load_session(folder)
    problem = is_refused(client, zipped(folder))
    assert problem["detail"] == str(caught.value)
    expected = (caught.value.file, caught.value.column, caught.value.line)
    assert (problem["file"], problem["column"], problem["line"]) == expected


def test_what_takes_the_model_to_see_is_seen_at_the_upload(
    client: TestClient, folder: Path
) -> None:
    words(declared_effects=[{"effect": "viscoelastic_joint", "joint": "knee"}])(folder)
    assert "knee" in is_refused(client, zipped(folder))["detail"]
    words(declared_effects=[])(folder)
    spoilt(folder, column=4, change=lambda effort: -effort)
    assert re.search("sign", is_refused(client, zipped(folder))["detail"])
    spoilt(folder, column=2, change=lambda angle: angle * 57.3)
    problem = is_refused(client, zipped(folder))
    assert "degrees" in problem["detail"] and problem["file"] == "a.csv"


def test_a_link_in_the_archive_is_refused(client: TestClient, folder: Path) -> None:
    linked("a.csv", "../outside/secret.csv")(folder)
    assert "'a.csv' in it is a link" in is_refused(client, zipped(folder))["detail"]


def test_a_bomb_is_refused_and_leaves_nothing_on_disk(
    client: TestClient, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    (folder / "zeros.csv").write_bytes(bytes(300_000_000))
    problem = is_refused(client, zipped(folder))
    assert "more than a recording takes" in problem["detail"]
    assert not list(scratch.iterdir())


def test_a_look_that_takes_too_long_or_too_much_is_given_up(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zipped(folder)
    file = folder.with_suffix(".zip")
    started = time.monotonic()
    with pytest.raises(sandbox.BadFileError, match=r"session\.zip: reading it takes more"):
        asyncio.run(sandbox.check("analysis.closeloop.check", file, seconds=0))
    assert time.monotonic() - started < 5.0
    with pytest.raises(sandbox.BadFileError, match=r"session\.zip: .*(memory|status)"):
        asyncio.run(sandbox.check("analysis.closeloop.check", file, memory_mb=40))


def test_the_look_knows_no_secrets_and_imports_nothing_of_the_session(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "numpy.py").write_text("raise SystemExit('imported')")
    monkeypatch.setenv("REHYB_TOKEN", "hunter2")
    monkeypatch.chdir(folder)
    ran: list[Any] = []
    begin = asyncio.create_subprocess_exec

    async def spy(*command: str, **options: Any) -> Any:
        ran.append((command, options))
        return await begin(*command, **options)

    monkeypatch.setattr(sandbox.asyncio, "create_subprocess_exec", spy)
    zipped(folder)
    understood = asyncio.run(sandbox.check("analysis.closeloop.check", folder.with_suffix(".zip")))
    assert understood["analysed_joints"] == ["elbow"]
    assert "hunter2" not in str(ran) and "PATH" in ran[0][1]["env"]
