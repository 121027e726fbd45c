"""The `rehyb` command in this process, beside a coordinator that a test makes up."""

from collections.abc import Callable
from functools import partial

import httpx2
import pytest

from rehyb.cli import main
from rehyb.client import Client
from tests.testbed.transport import CoordinatorTransport

Run = Callable[..., tuple[int, str, str]]
Coordinator = Callable[[httpx2.Request], httpx2.Response]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command and return its exit status, its output and its errors."""
    monkeypatch.setenv("REHYB_TOKEN", "t")

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["rehyb", *arguments])
        status = 0
        try:
            main()
        except SystemExit as leaving:
            status = int(leaving.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def talk_to(monkeypatch: pytest.MonkeyPatch) -> Callable[[Coordinator], None]:
    """Have every command talk to this coordinator."""

    def talk_to(coordinator: Coordinator) -> None:
        mocked = partial(Client, transport=CoordinatorTransport(coordinator))
        for module in ("answers", "studies", "precision", "files", "close_loop", "pilots"):
            monkeypatch.setattr(f"rehyb.cli.{module}.Client", mocked)

    return talk_to
