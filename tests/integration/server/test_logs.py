"""What is logged can be read by a machine, and says what it is about."""

import json
import logging
from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from server.logs import configure


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    yield
    root.handlers[:], root.level = handlers, level


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    return [json.loads(line) for line in capsys.readouterr().err.splitlines()]


def test_a_log_line_is_json_with_time_level_and_what_it_is_about(
    capsys: pytest.CaptureFixture[str],
) -> None:
    configure("info")
    logging.getLogger("any").info("granted %d", 3, extra={"lease": "l", "worker": "w"})
    logging.getLogger("any").debug("not wanted")
    (line,) = lines(capsys)
    assert line.pop("timestamp")
    assert line == {
        "event": "granted 3",
        "level": "info",
        "logger": "any",
        "lease": "l",
        "worker": "w",
    }


def test_an_exception_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    configure("warning")
    try:
        raise RuntimeError("no")
    except RuntimeError:
        logging.getLogger("any").exception("it failed")
    (line,) = lines(capsys)
    assert "RuntimeError: no" in str(line["exception"])


def test_leases_and_refused_results_are_logged_with_their_ids(
    client: TestClient, capsys: pytest.CaptureFixture[str]
) -> None:
    configure("info")
    logging.getLogger("httpx2").setLevel(logging.WARNING)
    study = {"name": "s", "model": "ishigami", "method": "morris", "rows": 1}
    study_id = client.post("/v1/studies", json=study).json()["id"]
    asking = {"worker": {"id": "w", "host": "h"}, "models": ["ishigami"], "max_instances": 1}
    lease = client.post("/v1/leases", json=asking).json()
    forged = {"instance": "x", "outcome": "ok"}
    body = {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": [forged]}
    assert client.post("/v1/results", json=body).status_code == 409
    granted, refused = (line for line in lines(capsys) if "server.routes" in str(line["logger"]))
    assert (granted["study"], granted["lease"], granted["worker"], granted["instances"]) == (
        study_id,
        lease["id"],
        "w",
        1,
    )
    assert (refused["instance"], refused["lease"]) == ("x", lease["id"])
