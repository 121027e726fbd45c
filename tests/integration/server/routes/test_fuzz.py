"""Whatever bytes come, the coordinator answers with a sentence, and what it has stays whole.

What the OpenAPI document allows, and near it, is asked by `test_contract`; here requests are
spoilt in their bytes, their wrapping and their headers. `make soak` spoils more.
"""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from pydantic import SecretStr

from server.app import create_app
from server.errors import BadFileError
from server.operations import check
from server.operations.study import studies
from server.settings import Settings
from tests.testbed import spoiling

TOKEN = "fuzz"
#: Requests.
REQUESTS = int(os.environ.get("REHYB_FUZZ", "150"))
WORKER = {"id": "w", "host": "h", "versions": {"mujoco": "4.0.1"}, "tags": [], "canaries": {}}
ASKED = {"worker": WORKER, "models": ["ishigami"], "max_instances": 2}
#: Bodies that are right, by path; S, L and C stand for a study, a lease and a close-loop.
BODIES: dict[str, Any] = {
    "/v1/studies": {
        "name": "s",
        "model": "ishigami",
        "method": "saltelli",
        "rows": 2,
        "factors": [
            {"name": "x1", "range": [0.0, 1.0]},
            {"name": "x2", "distribution": {"type": "normal", "mean": 0.0, "sd": 1.0}},
        ],
        "fixed": {"x3": 0.5},
        "outputs": ["y"],
        "groups": {},
        "seed": 1,
        "tags": ["t"],
        "precision": {"output": "y", "target": 0.1, "up_to": 64},
        "correlations": [["x1", "x2", 0.5]],
    },
    "/v1/studies/S/extend": {"rows": 3},
    "/v1/studies/S/rerun": {"which": "failed", "outcomes": ["crashed"]},
    "/v1/studies/S/precision": {"output": "y", "target": 0.1, "up_to": 64},
    "/v1/studies/S/priority": {"priority": 3},
    "/v1/studies/S/analyses": {},
    "/v1/leases": ASKED,
    "/v1/leases/L/renew": {"fence": 1},
    "/v1/leases/L/release": {"fence": 1},
    "/v1/results": {
        "lease": "L",
        "fence": 1,
        "worker": "w",
        "results": [
            {
                "instance": "S:0:0",
                "outcome": "ok",
                "outputs": {"y": 0.5},
                "reason": "",
                "state": {"time": 0.4, "qpos": [0.1, 0.2]},
                "wall_seconds": 0.1,
            },
            {"instance": "S:0:1", "outcome": "diverged", "outputs": {}, "reason": "far away"},
        ],
        "next": ASKED,
    },
    "/v1/models": {
        "name": "pendulum",
        "kind": "command",
        "factors": [{"name": "length", "unit": "m", "low": 0.2, "high": 0.4, "nominal": 0.3}],
        "outputs": [{"name": "period", "unit": "s"}],
    },
    "/v1/close-loops/lease": {"worker": WORKER},
    "/v1/close-loops/C/renew": {"fence": 1},
    "/v1/close-loops/C/release": {"fence": 1},
    "/v1/close-loops/C/failure": {"fence": 1, "error": {"sentence": "it is no robot"}},
    "/v1/sign-in-codes": {},
}
_FORM = "multipart/form-data; boundary=b"
_PART = (
    b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.zip"\r\n\r\nPK\r\n--b--\r\n'
)
#: Other bodies that are right in form: (path, type, body).
FILES = (
    ("/v1/sessions", _FORM, _PART),
    ("/v1/models", _FORM, _PART),
    ("/v1/analyses?output=y&factor=x", _FORM, _PART),
    ("/v1/analyses?output=y&factor=x", "text/csv", b"x,y\n1,2\n3,4\n"),
    ("/v1/sessions", "application/zip", b"PK\x03\x04"),
    ("/v1/close-loops/C/report?fence=1", _FORM, _PART),
    ("/sign-in", "application/x-www-form-urlencoded", b"token=fuzz&next=%2F"),
)


@pytest.fixture
def apps(
    upgraded_database: Any, upgraded_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[dict[FastAPI, TestClient]]:
    """Coordinators on either database, which have a process refuse every file."""

    async def refuse(_program: str, file: Path, **_wanted: Any) -> Any:
        raise BadFileError(f"{file.name}: is spoilt", file=file.name)

    for noun in ("sessions", "models", "analyses"):
        monkeypatch.setattr(f"server.routes.{noun}.check", refuse)
    file = shutil.copyfile(upgraded_file, tmp_path / "rehyb.sqlite3")
    with ExitStack() as stack:
        apps = {}
        for url in (f"sqlite:///{file}", upgraded_database()):
            app = create_app(
                Settings(database_url=url, token=SecretStr(TOKEN), session_bytes=100_000)
            )
            client = TestClient(app, raise_server_exceptions=False, follow_redirects=False)
            apps[app] = stack.enter_context(client)
        yield apps


def _known(client: TestClient, headers: dict[str, str]) -> tuple[str, str, int]:
    """Return a running study and a lease of its instances with its fence."""
    plain = {"name": "s", "model": "ishigami", "method": "morris", "rows": 500}
    study = client.post("/v1/studies", json=plain, headers=headers).json()["id"]
    lease = client.post("/v1/leases", json={**ASKED, "max_instances": 8}, headers=headers).json()
    return study, lease["id"], lease["fence"]


# Starlette leaves the file of a part that is cut off to the garbage collector, which closes it.
@pytest.mark.filterwarnings("ignore:Unclosed file <tempfile.SpooledTemporaryFile:ResourceWarning")
def test_whatever_bytes_come_it_answers_with_a_sentence(apps: dict[FastAPI, TestClient]) -> None:
    token = {"authorization": f"Bearer {TOKEN}"}
    known = {app: _known(client, token) for app, client in apps.items()}
    answers: set[int] = set()

    def ask(path: str, body: bytes, headers: dict[str, str]) -> None:
        for app, client in apps.items():
            study, lease, fence = known[app]
            where = path.replace("/S", f"/{study}").replace("/L/", f"/{lease}/")
            what = body.replace(b'"S:', f'"{study}:'.encode()).replace(
                b'"L"', f'"{lease}"'.encode()
            )
            what = what.replace(b'"fence": 1', f'"fence": {fence}'.encode())
            raw = [(name.encode(), text.encode("latin-1")) for name, text in headers.items()]
            answer = client.post(where, content=what, headers=raw)
            answers.add(answer.status_code)
            told = (app.state.settings.database_url, where, what[:500], headers, answer.text[:300])
            assert answer.status_code < 500, told
            # Of results each has a verdict.
            if answer.status_code >= 400 and not ("verdicts" in answer.text or path == "/sign-in"):
                assert answer.headers["content-type"] == "application/problem+json", told
                assert answer.json()["detail"], told

    kinds = [*BODIES, *FILES]

    @settings(
        max_examples=REQUESTS,
        deadline=None,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(
        kind=st.sampled_from(kinds),
        swaps=spoiling.SWAPS,
        edits=st.one_of(st.just([]), spoiling.EDITS),
        wrapping=st.sampled_from(["plain"] * 5 + [*spoiling.WRAPPINGS]),
        extra=st.sampled_from(({}, {}, {}, *spoiling.HEADERS)),
    )
    @example(kind="/v1/results", swaps=[], edits=[], wrapping="gzip", extra={})
    def spoil(kind: Any, swaps: Any, edits: Any, wrapping: str, extra: dict[str, str]) -> None:
        if isinstance(kind, str):
            path, sort, body = kind, "application/json", spoiling.swapped(BODIES[kind], swaps)
        else:
            path, sort, body = kind
        encoding, wrap = spoiling.WRAPPINGS[wrapping]
        headers = {**token, "content-type": sort} | extra
        if encoding:
            headers["content-encoding"] = encoding
        ask(path, wrap(spoiling.edited(body, edits)), headers)

    spoil()
    # Some must have got through, and some must not.
    assert {200, 422} <= answers
    for app, client in apps.items():
        assert check.faults(app.state.engine) == []
        for study in studies.every(app.state.engine):
            # Whatever was taken can be told.
            for what in ("", "/progress", "/instances", "/results.csv"):
                told = client.get(f"/v1/studies/{study.id}{what}", headers=token)
                assert told.status_code == 200, (study.id, what, told.text)
            json.dumps(client.get(f"/v1/studies/{study.id}", headers=token).json())
