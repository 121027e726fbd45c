"""What is printed: tables on narrow terminals and in pipes lose no number, and one is no plural."""

import pytest

from rehyb.cli.answers import study_submitted
from rehyb.cli.study.control import _state
from rehyb.display import indices_table, pairs_table, plain_table, whole_console


def test_a_table_is_not_cut_where_eighty_columns_are_too_few(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A study's indices were `0.618 [0.51, 0.…` in a file, and `rehyb validate` had no numbers."""
    monkeypatch.setenv("COLUMNS", "80")
    table = plain_table("factor", "S", "ST", title="of stiffness_error")
    numbers = "0.618 [0.512, 0.724]", "0.701 [0.598, 0.804] of a sentence that goes on and on"
    table.add_row("upper_arm_length_of_the_wearer", *numbers)
    whole_console().print(table)
    lines = capsys.readouterr().out.splitlines()
    assert any(all(number in line for number in numbers) for line in lines)
    assert lines[0].rstrip() == "of stiffness_error"


def test_brackets_and_colons_of_names_are_printed_as_they_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """`[m]` was missing, and `len [/b]` a traceback: names of a file's columns were markup."""
    names = ("force [N]", "[red]x[/red]", "len [/b]", ":smile:")
    none = {"value": None, "low": None, "high": None}
    factors = {name: {"total_order": none, "n": 0} for name in names}
    console = whole_console()
    console.print(indices_table({"outputs": {"y [/]": {"factors": factors}}}, "y [/]", "y [/]"))
    console.print(pairs_table([{"factors": names, "n": 0, **none}]))
    console.print(plain_table(*names, title="y [/]", caption="[m]"))
    said = capsys.readouterr().out
    assert all(said.count(name) == 3 for name in names)
    assert said.count("y [/]") == 2 and "[m]" in said


def test_one_of_a_thing_is_no_plural() -> None:
    study = {"id": "s1", "name": "one", "state": "running", "priority": 0}
    one = study | {"rows": 1, "instances": 1}
    assert study_submitted(one).text == "s1  one: 1 instance"
    assert study_submitted(study | {"instances": 20}).text == "s1  one: 20 instances"
    assert _state(one).text == "s1 is running: 1 row, 1 instance, priority 0"
