"""What is asked of a batch system, which may hang, and what it leaves behind."""

import time
from pathlib import Path

import pytest

from rehyb.errors import FleetError
from rehyb.pilots.commands import run
from rehyb.pilots.engines import ParslEngine


def test_a_command_answers_with_its_status_and_what_it_printed() -> None:
    assert run("echo out; echo err >&2; exit 3") == (3, "out\n", "err\n")
    assert run(r"printf '\377'") == (0, "�", "")


def test_a_command_answers_though_what_it_started_holds_its_output_open() -> None:
    began = time.monotonic()
    assert run("sleep 3 & echo done", 2.0) == (0, "done\n", "")
    assert time.monotonic() - began < 2.0


def test_a_command_that_hangs_is_one_sentence_and_leaves_nothing_behind(tmp_path: Path) -> None:
    late = tmp_path / "late"
    with pytest.raises(TimeoutError, match=r"^sh gave no answer within 0\.05 s$"):
        run(f"sh -c 'sleep 0.2; touch {late}' & wait", 0.05)
    time.sleep(0.3)
    assert not late.exists()


@pytest.mark.parametrize(
    ("sbatch", "said"),
    [
        ("exec sleep 60", "sbatch gave no answer within 0.2 s"),
        ("echo Welcome", "the batch system gave the job no number"),
        ("echo 'sbatch: error: no such account' >&2; exit 1", "sbatch: error: no such account"),
    ],
)
def test_what_keeps_a_batch_system_from_taking_a_job_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sbatch: str, said: str
) -> None:
    commands = tmp_path / "bin"
    commands.mkdir()
    warning = "echo 'sbatch: warning: odd' >&2"
    for name, script in {"sacct": "exit 1", "sbatch": f"{warning}; {sbatch}"}.items():
        (commands / name).write_text(f"#!/bin/sh\n{script}\n")
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}:/usr/bin:/bin")
    engine = ParslEngine(
        "slurm", folder=tmp_path / "site", walltime=60.0, cores=1, before="", options={}
    )
    if "sleep" in sbatch:
        monkeypatch.setattr(engine._provider, "cmd_timeout", 0.2)
    with pytest.raises(FleetError) as refusal:
        engine.submit("true", "pilot")
    assert str(refusal.value) == said
