"""What a pilots file may say."""

from pathlib import Path
from typing import Any

import pytest

from rehyb.durations import seconds
from rehyb.errors import Invalid
from rehyb.pilots.settings import checked, read
from tests.testbed.command import Run

FILE = {"provider": "local", "walltime": "1h", "cores": 4, "maximum": 3}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("90", 90),
        ("90s", 90),
        ("1.5m", 90),
        ("1h30m", 5400),
        ("2h", 7200),
        ("1d", 86400),
        ("02:00:00", 7200),
        ("1-00:00:10", 86410),
        (" 2 H ", 7200),
    ],
)
def test_a_time_is_written_as_people_do(text: str, expected: float) -> None:
    assert seconds(text, "walltime") == expected


@pytest.mark.parametrize("text", ["", "0", "soon", "-1h", "2 weeks", "00:99:00", "1e3", "0s", "h"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(Invalid, match="walltime is a time like 90s"):
        seconds(text, "walltime")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"provider": "cloud"}, "there is no provider 'cloud': take local, slurm, pbs"),
        ({"walltime": "2m"}, "too short for an instance, which may take 120 s"),
        ({"walltime": "20s", "instance": 1}, "too short for an instance"),
        ({"walltime": "long"}, "walltime is a time like 90s"),
        ({"walltime": [1]}, "walltime is a time like 90"),
        (
            {"walltime": "99999999999999999999h"},
            "walltime is a year at most, not '99999999999999999999h'",
        ),
        ({"idle": "9" * 400 + "h"}, "idle is a year at most, not '9999"),
        ({"instance": "0.01s"}, "instance is 0.1 s at least, .* not '0.01s'"),
        ({"worker": ""}, "worker is '': it is the command of a worker on one line"),
        ({"worker": "w\nrm -rf x"}, "what comes before it is said as `before`"),
        ({"worker": "'unclosed"}, "on one line, .* and this one has No closing quotation"),
        ({"cores": 0}, "cores is a whole number from 1 to 100000, not 0"),
        ({"cores": 2**63 - 1}, "cores is a whole number from 1 to 100000, not 9223372036854775807"),
        ({"cores": True}, "cores is a whole number from 1"),
        ({"minimum": 4}, "minimum = 4 is more than maximum = 3"),
        ({"minimun": 1}, "there is no entry 'minimun': the entries are provider"),
        ({"before": 3}, "before is a text in quotes, not 3"),
        ({"before": "module\0load"}, r"before has the control character '\\x00': it goes into a"),
        ({"worker": "w --tags \x1b[2J"}, r"worker has the control character '\\x1b'"),
        ({"before": "a\rb"}, r"before has the control character '\\r'"),
        (
            {"options": {"account": "a\x7f"}},
            r"\[options\] account has the control character '\\x7f'",
        ),
        ({"options": "x"}, r"options is a table, \[options\]"),
    ],
)
def test_a_pilots_file_that_cannot_be_is_one_sentence(change: dict[str, Any], words: str) -> None:
    with pytest.raises(Invalid, match=words):
        checked({**FILE, **change})


def test_lines_before_the_worker_may_be_indented_by_tabs() -> None:
    lines = "if true; then\n\tmodule load café\nfi\n"
    assert checked({**FILE, "before": lines}).before == lines


def test_a_pilots_file_that_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "site.toml"
    with pytest.raises(Invalid, match=r"site.toml cannot be read: No such file"):
        read(file)
    file.write_text("provider = ")
    with pytest.raises(Invalid, match=r"site.toml is not TOML"):
        read(file)
    file.write_text("cores = 1")
    with pytest.raises(Invalid, match=r"site.toml: provider is missing"):
        read(file)


def test_without_the_batch_systems_command_it_says_where_to_run(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    file = tmp_path / "site.toml"
    file.write_text('provider = "slurm"\nwalltime = "1h"\ncores = 1\nmaximum = 1\n')
    status, _, words = run("pilots", str(file))
    assert status == 2
    assert words.startswith("rehyb: there is no sbatch on this machine")
    assert len(words.splitlines()) == 1
