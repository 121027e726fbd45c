"""A page of figures says what they are of, its command exists, and a run keeps its text."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks import measurement
from benchmarks.measurement import Header, MeasurementError, age, digest, measure, rewritten
from rehyb.cli import app

ROOT = Path(__file__).parents[2]
PAGE = """# A page

Its text.

- Machine: a processor, 2 cores, Linux-x86_64, Python 3.11.7, MuJoCo 4.0.1
- Date: 2026-11-20
- Command: `python -c "print('new')"`
- Commit: unknown
- Measures: `room`, `other/file.py`
- Sources: unknown
- Written: by hand

<!-- figures -->
old
<!-- end of figures -->

- Remark: stays
"""


def exists(command: str) -> bool:
    words = shlex.split(command)
    if words[:2] == ["python", "-m"]:
        return importlib.util.find_spec(words[2]) is not None
    if words[0] == "make":
        return f"\n{words[1]}:" in (ROOT / "Makefile").read_text()
    names = [word for word in words[1:3] if re.fullmatch("[a-z-]+", word)]
    return words[0] == "rehyb" and CliRunner().invoke(app, [*names, "--help"]).exit_code == 0


@pytest.mark.parametrize("page", measurement.pages(), ids=lambda page: page.stem)
def test_every_page_says_what_its_figures_are_of(page: Path) -> None:
    header = Header.read(page.read_text())
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", header.date)
    assert re.search(r"\d+ cores?, .*Python \d+\.\d+", header.machine)
    assert exists(header.command), header.command
    assert header.measures
    for name in header.measures:
        assert (ROOT / name).exists(), name
    assert re.fullmatch(r"unknown|[0-9a-f]{16}", header.sources)
    assert header.written == "by the command" or header.written.startswith("by hand on ")
    assert rewritten(page.read_text(), header, "figures")


def test_a_header_comes_back_as_it_was_written() -> None:
    header = Header.read(PAGE)
    assert header.measures == ("room", "other/file.py")
    assert "\n".join(header.lines()) in PAGE


def test_a_page_without_an_item_is_refused() -> None:
    with pytest.raises(MeasurementError, match="commit"):
        Header.read(PAGE.replace("- Commit: unknown\n", ""))
    with pytest.raises(MeasurementError, match="end of figures"):
        rewritten(PAGE.replace("<!-- end of figures -->", ""), Header.read(PAGE), "new")


def test_figures_are_current_until_a_source_changes(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("1")
    (tmp_path / "room" / "notes.txt").write_text("1")
    now = digest(["room"], tmp_path)
    header = Header.read(PAGE.replace("Sources: unknown", f"Sources: {now}"))
    assert "as it is" in age(header, tmp_path)
    (tmp_path / "room" / "notes.txt").write_text("2")
    assert "as it is" in age(header, tmp_path)
    (tmp_path / "room" / "a.py").write_text("2")
    assert "older than room" in age(header, tmp_path)
    assert "by hand" in age(Header.read(PAGE), tmp_path)


def test_a_run_replaces_header_and_figures_and_keeps_the_text(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    measure(page)
    text = page.read_text()
    assert "<!-- figures -->\n```text\nnew\n```\n<!-- end of figures -->" in text
    assert "old" not in text
    assert "Its text." in text
    assert "- Remark: stays" in text
    assert Header.read(text).written == "by the command"
    assert Header.read(text).sources == digest(["room", "other/file.py"])


def test_a_command_that_fails_leaves_the_page_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE.replace("print('new')", "exit(3)"))
    with pytest.raises(MeasurementError, match="ended with 3"):
        measure(page)
    assert "old" in page.read_text()
