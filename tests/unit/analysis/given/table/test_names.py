"""What columns are called, however a program or a person writes it, and what is quoted of it."""

from pathlib import Path

import numpy as np
import pytest

from analysis.given.rows.sample import choose
from analysis.given.table.reading import Sheet, read_sheet
from analysis.given.table.refusals import GivenError
from tests.testbed.given import written


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("index", [False, True])
def test_a_header_that_counts_the_columns_is_names_and_no_run(
    tmp_path: Path, start: int, index: bool
) -> None:
    """It was one more run, far from all others, without a word."""
    table = np.random.default_rng(1).random((80, 3)) / 100.0
    names = [str(start + n) for n in range(3)]
    if index:
        table = np.column_stack([np.arange(80), table])
        names = ["", *names]
    path = written(tmp_path / "numbered.csv", table, ",".join(names))
    found = choose(read_sheet(path), [names[-1]])
    assert len(found.x) == 80 and found.factors == tuple(names[-3:-1])
    assert any("is taken for the names of columns" in remark for remark in found.remarks)


@pytest.mark.parametrize("first", ["0,1", "0,1,3", "0.0,1.0,2.0", "2,3,4"])
def test_other_numbers_are_a_run(tmp_path: Path, first: str) -> None:
    table = np.random.default_rng(1).random((80, first.count(",") + 1))
    assert len(choose(read_sheet(written(tmp_path / "x.csv", table, first)), ["column_2"]).x) == 81


@pytest.mark.parametrize("separator", [",", " "])
def test_names_behind_a_mark_of_comments_right_above_numbers_are_names(
    tmp_path: Path, separator: str
) -> None:
    table = np.random.default_rng(1).random((80, 3))
    path = tmp_path / "saved.csv"
    header = separator.join(["mass", "k", "y"])
    np.savetxt(path, table, header=f"made by hand\n{header}", delimiter=separator)
    sheet = read_sheet(path)
    assert (
        sheet.columns == ("mass", "k", "y") and sheet.numbers["y"].tolist() == table[:, 2].tolist()
    )
    np.savetxt(path, table, header="seed 3", delimiter=separator)
    assert read_sheet(path).columns == ("column_1", "column_2", "column_3")
    np.savetxt(path, table, header=separator.join("123"), delimiter=separator)
    assert read_sheet(path).unlabelled


def test_a_column_is_found_without_its_unit_if_only_one_is_called_so(tmp_path: Path) -> None:
    table = np.random.default_rng(1).random((80, 3))
    sheet = read_sheet(written(tmp_path / "u.csv", table, "a [kg],b (mm),y [Nm]"))
    assert choose(sheet, ["y"], ["b"]).outputs == ("y [Nm]",)
    twice = read_sheet(written(tmp_path / "u.csv", table, "a [kg],y [mm],y [Nm]"))
    with pytest.raises(GivenError, match="no column 'y'"):
        choose(twice, ["y"])


def test_what_is_quoted_of_a_file_is_bounded(tmp_path: Path) -> None:
    """A JSON file was quoted as a whole: 22 631 characters."""
    path = tmp_path / "runs.json"
    path.write_text('[{"a": 1, "y": 2}' + ', {"a": 1, "y": 2}' * 1000 + "]")
    with pytest.raises(GivenError, match="tables are read as CSV or Parquet"):
        read_sheet(path)
    # A name may begin with a bracket.
    path.write_text("[m] a,{y}\n" + "1,2\n" * 3)
    assert read_sheet(path).columns == ("[m] a", "{y}")
    names = [f"{n}{'x' * 200}" for n in range(500)]
    wide = Sheet(
        file="w.csv", columns=tuple(names), numbers={n: np.arange(80.0) for n in names}, texts={}
    )
    for outputs in ([], ["z" * 5000]):
        with pytest.raises(GivenError, match="470 more") as caught:
            choose(wide, outputs)
        assert len(str(caught.value)) < 2500
