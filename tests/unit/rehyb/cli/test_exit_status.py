"""Exit status: 2 for what is not there or not what a command takes, 1 for what failed."""

from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., tuple[int, str, str]]
LOG = "time,elbow.position,elbow.effort\n" + "".join(f"{i / 100},{i},1\n" for i in range(300))


@pytest.mark.parametrize(
    "command",
    [
        "reproduce nothere.zip --check",
        "reproduce . --check",
        "reproduce log.csv --check",
        "inspect nothere.csv",
        "inspect log.csv --model nothere.xml",
        "analyse nothere.csv --output y",
        "analyse . --output y",
        "close-loop nothere --out out",
        "close-loop log.csv --out out",
        "interpret nothere.npz",
        "study submit nothere.json",
        "study with-effect nothere.json",
        "study of-session nothere nothere",
        "model check nothere",
        "assess --replay nothere.json",
        "assess --set nothing=1",
    ],
)
def test_what_is_not_there_or_not_what_a_command_takes_is_status_2(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(LOG)
    status, out, err = run(*command.split())
    assert (status, out) == (2, "") and err and "Traceback" not in err


@pytest.mark.parametrize("command", ["study list", "study show s1", "report s1 --out r.html"])
def test_a_coordinator_that_is_away_is_status_1(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*command.split(), "--url", "http://127.0.0.1:9")[0] == 1


def test_a_models_folder_that_is_not_there_is_named(run: Run, tmp_path: Path) -> None:
    there = str(tmp_path / "nothere")
    for command in ("check", "add"):
        found = run("model", command, there)
        assert found == (2, "", f"rehyb: {there}: there is no such folder\n")
