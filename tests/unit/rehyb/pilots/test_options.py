"""What a pilots file may pass on to the provider of a batch system."""

from pathlib import Path
from typing import Any

import pytest

from rehyb.errors import Invalid
from rehyb.pilots.engines import ParslEngine


@pytest.fixture(autouse=True)
def every_batch_system_is_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rehyb.pilots.engines.shutil.which", lambda command: command)


def engine(name: str, folder: Path, options: dict[str, Any]) -> ParslEngine:
    return ParslEngine(name, folder=folder, walltime=60.0, cores=1, before="", options=options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"partiton": "x"}, "has no 'partiton': it takes cmd_timeout"),
        ({"max_blocks": 3}, "has no 'max_blocks'"),
    ],
)
def test_an_option_that_a_provider_lacks_is_one_sentence(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(Invalid, match=words):
        engine("local", tmp_path, options)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("slurm", {"mem_per_node": "lots"}, "mem_per_node is a whole number, not 'lots'"),
        ("slurm", {"mem_per_node": True}, "mem_per_node is a whole number, not True"),
        ("slurm", {"partition": ["day"]}, "partition is a text in quotes, not ['day']"),
        ("slurm", {"exclusive": "yes"}, "exclusive is true or false, not 'yes'"),
        ("condor", {"mem_per_slot": "2G"}, "mem_per_slot is a number, not '2G'"),
        (
            "condor",
            {"environment": "A=b"},
            "environment is a table of texts, as {a = 'b'}, not 'A=b'",
        ),
        (
            "condor",
            {"transfer_input_files": "a"},
            "transfer_input_files is a list of texts, as ['a', 'b'], not 'a'",
        ),
        # It says nothing of kinds, but has defaults.
        ("pbs", {"scheduler_options": 3}, "scheduler_options is a text in quotes, not 3"),
        ("local", {"cmd_timeout": "1m"}, "cmd_timeout is a number, not '1m'"),
    ],
)
def test_an_option_of_another_kind_is_one_sentence_that_says_which_is_wanted(
    tmp_path: Path, name: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(Invalid) as refusal:
        engine(name, tmp_path / "site", options)
    assert str(refusal.value) == f"[options] of {name}: {words}"


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("slurm", {"mem_per_node": 4, "partition": "day", "exclusive": True}),
        ("condor", {"mem_per_slot": 2, "environment": {"A": "b"}, "transfer_input_files": ["a"]}),
        ("pbs", {"account": "lab-7", "scheduler_options": "#PBS -l x"}),
        ("local", {"cmd_timeout": 2.5}),
    ],
)
def test_options_of_the_kinds_that_are_wanted_are_taken(
    tmp_path: Path, name: str, options: dict[str, Any]
) -> None:
    engine(name, tmp_path / "site", options)


def test_what_a_provider_itself_refuses_is_told_whole_in_one_line(
    tmp_path: Path,
) -> None:
    with pytest.raises(Invalid, match="is not an instance of str") as refusal:
        engine("condor", tmp_path / "site", {"environment": {"A": 1}})
    said = str(refusal.value)
    assert len(said.splitlines()) == 1 and not said.endswith(":")


def test_a_folder_that_needs_quotes_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match=r"my site has characters .* with --directory"):
        engine("local", tmp_path / "my site", {})
