"""What is asked of a batch system, which may hang, and what it leaves behind."""

import time
from pathlib import Path

import pytest

from rehyb.errors import FleetError
from rehyb.pilots.commands import run
from rehyb.pilots.engines import JobState, ParslEngine


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


def slurm_of(folder: Path, monkeypatch: pytest.MonkeyPatch, **scripts: str) -> None:
    """Have commands of Slurm that do as they are told."""
    commands = folder / "bin"
    commands.mkdir()
    for name, script in scripts.items():
        (commands / name).write_text(f"#!/bin/sh\n{script}\n")
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}:/usr/bin:/bin")


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
    warning = "echo 'sbatch: warning: odd' >&2"
    slurm_of(tmp_path, monkeypatch, sacct="exit 1", sbatch=f"{warning}; {sbatch}")
    engine = ParslEngine(
        "slurm", folder=tmp_path / "site", walltime=60.0, cores=1, before="", options={}
    )
    if "sleep" in sbatch:
        monkeypatch.setattr(engine._provider, "cmd_timeout", 0.2)
    with pytest.raises(FleetError) as refusal:
        engine.submit("true", "pilot")
    assert str(refusal.value) == said


def test_a_job_that_a_list_lacks_is_asked_for_again_and_may_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = tmp_path / "answer"
    slurm_of(
        tmp_path,
        monkeypatch,
        sacct="exit 1",
        sbatch="echo Submitted batch job 7",
        squeue=f". {answer}",
    )
    engine = ParslEngine(
        "slurm", folder=tmp_path / "site", walltime=60.0, cores=1, before="", options={}
    )
    assert engine.submit("true", "pilot") == "7"

    def state(squeue: str) -> JobState:
        answer.write_text(squeue)
        return engine.states(["7"])["7"]

    assert state("echo 7 R") == JobState.RUNNING
    assert state("true") == JobState.MISSING
    assert state("exit 1") == JobState.MISSING, "no answer changes nothing"
    assert state("echo 7 R") == JobState.RUNNING
    assert state("exit 1") == JobState.RUNNING
    assert state("echo 7 TO") == JobState.ENDED


@pytest.mark.parametrize(
    ("squeue", "said"),
    [
        ("echo JOBID; echo 7", r"answer cannot be read: it begins with 'JOBID\n7\n'"),
        ("echo JOBID STATE", r"answer cannot be read: it begins with 'JOBID STATE\n'"),
        ("exec sleep 60", " does not answer: squeue gave no answer within 0.2 s"),
    ],
)
def test_what_a_list_says_that_is_none_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, squeue: str, said: str
) -> None:
    sbatch = "echo Submitted batch job 7"
    slurm_of(tmp_path, monkeypatch, sacct="exit 1", sbatch=sbatch, squeue=squeue)
    engine = ParslEngine(
        "slurm", folder=tmp_path / "site", walltime=60.0, cores=1, before="", options={}
    )
    job = engine.submit("true", "pilot")
    monkeypatch.setattr(engine._provider, "cmd_timeout", 0.2)
    with pytest.raises(FleetError) as trouble:
        engine.states([job])
    assert str(trouble.value).startswith("the batch system") and str(trouble.value).endswith(said)
