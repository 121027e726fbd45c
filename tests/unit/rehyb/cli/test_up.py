"""`rehyb up` listens where it is told to, by an option or by the environment."""

import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rehyb import fleet
from rehyb.cli import app
from rehyb.errors import FleetError
from tests.testbed.command import run as run

Run = Callable[..., tuple[int, str, str]]


def where(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> tuple[Any, Any]:
    """Return host and port that `rehyb up` asks for."""
    asked = start_nothing(monkeypatch)
    found = CliRunner().invoke(app, ["up", "--directory", str(folder), *arguments])
    assert isinstance(found.exception, FleetError), found.output
    return asked["host"], asked["port"]


def start_nothing(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Have `rehyb up` end where it would start a fleet; returns what it asks for, once it has."""
    asked: dict[str, Any] = {}

    def refuse(directory: Path, **options: Any) -> None:
        asked.update(options)
        raise FleetError("enough")

    monkeypatch.setattr(fleet, "LocalFleet", refuse)
    return asked


def test_the_environment_says_where_to_listen(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("REHYB_HOST", raising=False)
    monkeypatch.delenv("REHYB_PORT", raising=False)
    assert where(monkeypatch, tmp_path) == ("127.0.0.1", 8787)
    monkeypatch.setenv("REHYB_HOST", "127.0.0.2")
    monkeypatch.setenv("REHYB_PORT", "4711")
    assert where(monkeypatch, tmp_path) == ("127.0.0.2", 4711)


def test_an_option_goes_before_the_environment(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("REHYB_PORT", "4711")
    assert where(monkeypatch, tmp_path, "--port", "0")[1] == 0


def test_a_port_that_is_none_is_refused_with_the_name_of_its_variable(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("REHYB_PORT", "high")
    start_nothing(monkeypatch)
    found = CliRunner().invoke(app, ["up", "--directory", str(tmp_path)])
    assert found.exit_code == 2
    assert "REHYB_PORT" in found.output


@pytest.mark.parametrize(
    ("host", "status", "said"),
    [("127.0.0.1", 1, "something else listens on port"), ("nowhere.invalid", 2, "REHYB_HOST must")],
)
def test_where_it_cannot_listen_nothing_is_made(
    host: str, status: int, said: str, run: Run, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        folder = str(tmp_path / "new" / "fleet")
        found = run("up", "--directory", folder, "--host", host, "--port", port)
    assert found[:2] == (status, "") and found[2].startswith(f"rehyb: {said}")
    assert list(tmp_path.iterdir()) == []


def test_nor_for_a_token_that_no_request_can_bear(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "hush hush")
    assert run("up", "--directory", str(tmp_path / "fleet"), "--port", "0")[0] == 1
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_server_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "rehyb.cli.operate.services.find_spec", lambda name: None if name == "uvicorn" else object()
    )
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    start_nothing(monkeypatch)
    for command in ("up", "coordinator"):
        # What this process has imported before would be found.
        monkeypatch.delitem(sys.modules, "server.run", raising=False)
        found = CliRunner().invoke(app, [command])
        assert str(found.exception) == f"rehyb {command} needs uvicorn: pip install 'rehyb[server]'"
