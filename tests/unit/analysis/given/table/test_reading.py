"""Files of rows that somebody else sampled: what is understood, and what is refused."""

from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.given.rows.dependence import dependence
from analysis.given.rows.sample import FEWEST_ROWS, MOST_PAIRS, choose
from analysis.given.table.reading import Sheet, read_sheet
from analysis.given.table.refusals import GivenError
from tests.testbed.given import ROWS, written


@pytest.mark.parametrize(
    ("names", "cell"),
    [("a;b;c;y", "{:.17g}"), ("a; b;c ;y", "{:.17g}"), ("a,b,c,y", '"{:.17g}"')],
)
def test_separators_and_quotes_are_understood(
    tmp_path: Path, table: Any, names: str, cell: str
) -> None:
    sheet = read_sheet(written(tmp_path / "runs.csv", table, names, cell))
    assert sheet.columns == ("a", "b", "c", "y")
    assert np.array_equal(np.column_stack(list(sheet.numbers.values())), table)


def test_decimal_commas_byte_order_marks_and_tabs_are_understood(
    tmp_path: Path, table: Any
) -> None:
    path = tmp_path / "excel.csv"
    for separator in (";", "\t"):
        lines = [separator.join(f"{v:.17g}".replace(".", ",") for v in row) for row in table]
        text = separator.join("abcy") + "\r\n" + "\r\n".join(lines) + "\r\n"
        path.write_text("\ufeff" + text, newline="")
        sheet = read_sheet(path)
        assert np.array_equal(np.column_stack(list(sheet.numbers.values())), table)


@pytest.mark.parametrize(
    "dressed",
    [
        lambda t: "\n".join(line + "," for line in t),
        lambda t: "\n".join(["# run by X, 2026", "", *t]),
        lambda t: "\n".join(t).replace(",", " "),
        lambda t: "\n".join(t).replace(",", "   "),
        lambda t: "\r".join(t),
        lambda t: ("\n".join(t)).encode("utf-16"),
        lambda t: "\n\n" + "\n\n".join(t),
    ],
)
def test_what_programs_put_around_a_table_is_no_part_of_it(
    tmp_path: Path, table: Any, dressed: Any
) -> None:
    path = written(tmp_path / "runs.csv", table)
    found = dressed(path.read_text().splitlines())
    path.write_bytes(found if isinstance(found, bytes) else found.encode())
    sheet = read_sheet(path)
    assert sheet.columns == ("a", "b", "c", "y")
    assert np.array_equal(np.column_stack(list(sheet.numbers.values())), table)


@pytest.mark.parametrize(
    "dressed",
    [
        lambda t: [t[0], *(f"{line}," for line in t[1:])],
        lambda t: [f"{t[0]},", *t[1:]],
        lambda t: [*t, "", "  ", ""],
        lambda t: [t[0], *(line.replace(",", ',"",', 1) for line in t[1:])],
    ],
)
def test_lines_that_all_end_alike_are_read(tmp_path: Path, table: Any, dressed: Any) -> None:
    path = written(tmp_path / "runs.csv", table, "a,b,c,y")
    lines = dressed(path.read_text().splitlines())
    lines[0] = lines[0] if '""' not in lines[1] else "a,,b,c,y"
    path.write_text("\n".join(lines))
    sheet = read_sheet(path)
    assert sheet.columns == ("a", "b", "c", "y")
    assert np.array_equal(np.column_stack(list(sheet.numbers.values())), table)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: [*t[:6], "1,2,3", *t[7:]], "line 7 has 3 cells and not 4 as the lines before"),
        (lambda t: [*t[:6], "", *t[6:], "1"], f"line {ROWS + 3} has 1 cells and not 4"),
        (lambda t: [t[0], "1,2,3", *t[2:]], "line 2 has 3 cells and not 4"),
        (lambda t: [t[0], *(f"{r}," for r in t[1:9]), "1,2,3,"], "line 10 has 4 cells and not 5"),
        (lambda t: [f"{t[0]},e", *t[1:]], "line 2 has 4 cells and not 5"),
        (lambda t: [t[0], *(f"{r},1" for r in t[1:])], "line 2 has 5 cells and not 4"),
        (lambda t: ["a b c y", *(r.replace(",", " ") for r in t[1:40]), "1 2 3"], "line 41 has 3"),
        (lambda t: ["a b c y", "1 2 3 4", "1 2 3", "2 3 4 5"], "line 3 has 3 cells and not 4"),
        (lambda t: [*t[:5], '"1",2', *t[5:]], "line 6 has 2 cells and not 4"),
    ],
)
def test_lines_of_different_length_are_refused(
    tmp_path: Path, table: Any, change: Any, sentence: str
) -> None:
    path = written(tmp_path / "runs.csv", table)
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(GivenError, match=sentence) as caught:
        read_sheet(path)
    assert f"line {caught.value.line} has" in sentence


def test_truths_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    path.write_text("on,y\n" + "".join(f"TRUE,{n}\nfalse,-{n}\n" for n in range(1, 41)))
    sheet = read_sheet(path)
    assert set(sheet.numbers["on"]) == {0.0, 1.0}
    assert choose(sheet, ["y"]).factors == ("on",)


def test_a_table_without_names_has_numbered_columns(tmp_path: Path, table: Any) -> None:
    path = tmp_path / "plain.csv"
    np.savetxt(path, table, delimiter=",")
    assert read_sheet(path).columns == ("column_1", "column_2", "column_3", "column_4")
    with pytest.raises(GivenError, match="have no names; say which column is the output"):
        choose(read_sheet(path))
    assert choose(read_sheet(path), ["column_4"]).factors == ("column_1", "column_2", "column_3")


def test_parquet_is_read_as_csv_is(tmp_path: Path, table: Any) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    columns = {name: list(column) for name, column in zip("abcy", table.T, strict=True)}
    columns["a"][3] = None
    write_table(pa.table({**columns, "who": ["anna"] * ROWS}), tmp_path / "runs.parquet")
    sheet = read_sheet(tmp_path / "runs.parquet")
    assert sheet.texts == {"who": "anna"}
    assert np.isnan(sheet.numbers["a"][3]) and sheet.numbers["y"][4] == table[4, 3]


def test_what_is_left_out_is_said(tmp_path: Path, table: Any) -> None:
    path = tmp_path / "messy.csv"
    lines = [
        f"{a},{b},{'' if r < 3 else c},7,{'inf' if r == 5 else a},anna,{y}"
        for r, (a, b, c, y) in enumerate(table)
    ]
    path.write_text("\n".join(["a,b,c,still,a2,who,y", *lines]))
    sample = choose(read_sheet(path), ["y"])
    said = " ".join(sample.remarks)
    assert sample.factors == ("a", "b", "c", "a2")
    assert sample.complete.sum() == ROWS - 4
    assert "Columns of text are left out: who ('anna')" in said
    assert "Columns that do not vary are left out: still" in said
    assert f"4 of {ROWS} rows lack a cell" in said
    assert "a and a2 (+1.00)" in dependence(sample.factors, sample.x[sample.complete]).remarks[0]


@pytest.mark.parametrize(
    ("change", "outputs", "sentence"),
    [
        (lambda t: "", ["y"], "it is empty"),
        (lambda t: t[:4], ["y"], "it has 3 rows, and not the 64 or more that indices need"),
        (lambda t: t, [], "say which column is the output: it has a, b, c, y"),
        (lambda t: t, ["z"], "it has no column 'z': it has a, b, c, y"),
        (lambda t: ["a,b,a,y", *t[1:]], ["y"], "two columns are called 'a'"),
        (lambda t: [*t[:6], "12 kg,1,2,3", *t[7:]], ["y"], "line 7 of column a reads '12 kg'"),
        (lambda t: [*t[:6], "1,2,3,4,5", *t[7:]], ["y"], "line 7 has 5 cells and not 4"),
        (lambda t: [t[0], *(r.rpartition(",")[0] + ",2" for r in t[1:])], ["y"], "y is the same"),
        (lambda t: [*t[:6], "1e101,1,2,3", *t[7:]], ["y"], "column a has numbers beyond ±1e+100"),
        (lambda t: ["# nothing else"], ["y"], "it has no table"),
        (lambda t: ["\ufeff"], ["y"], "it has no table"),
        (lambda t: ["sep=;"], ["y"], "it has no table"),
        (lambda t: [t[0], *("x" + r for r in t[1:])], ["a"], "column a is text ('x0."),
        (lambda t: [t[0], *(r + "\0" for r in t[1:])], ["y"], "neither CSV nor Parquet"),
        (lambda t: [t[0], *(",,," + r.rpartition(",")[2] for r in t[1:])], ["y"], "only 0 of its"),
    ],
)
def test_what_cannot_be_analysed_is_one_sentence(
    tmp_path: Path, table: Any, change: Any, outputs: list[str], sentence: str
) -> None:
    path = written(tmp_path / "runs.csv", table)
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(GivenError) as caught:
        choose(read_sheet(path), outputs)
    assert sentence in str(caught.value)
    assert str(caught.value).startswith("runs.csv: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("mark", [".", ","])
def test_marks_that_may_be_of_thousands_are_refused(tmp_path: Path, mark: str) -> None:
    path, other = tmp_path / "t.csv", {".": ",", ",": "."}[mark]
    path.write_text(f"a;y\n12{mark}345;345\n345;1{mark}500\n")
    with pytest.raises(GivenError, match=r"beside '345': the .* may be of thousands"):
        read_sheet(path)
    path.write_text(f"a;y\n12{mark}345;0{mark}5\n345;1{mark}5\n")
    assert list(read_sheet(path).numbers["a"]) == [12.345, 345.0]
    path.write_text(f"a;y\n12{mark}345;0{other}5\n13{mark}345;1{other}5\n")
    with pytest.raises(GivenError, match="may be of thousands"):
        read_sheet(path)
    path.write_text(f"a;y\n12{mark}345;7{mark}000\n13{mark}345;8{mark}125\n")
    assert list(read_sheet(path).numbers["y"]) == [7.0, 8.125]


def test_what_spreadsheets_write_first_is_understood(tmp_path: Path) -> None:
    path = tmp_path / "excel.csv"
    path.write_text('sep=;\n"a\n(m)";"b; c"\n1;2\n3;4\n')
    sheet = read_sheet(path)
    assert sheet.columns == ("a (m)", "b; c") and list(sheet.numbers["a (m)"]) == [1.0, 3.0]
    path.write_text('"a\n(m)",b\n1,2\nx,4\n3,3\n')
    with pytest.raises(GivenError, match=r"line 4 of column a \(m\) reads 'x'"):
        read_sheet(path)


def test_parquet_of_decimals_empty_columns_and_equal_names(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    path = tmp_path / "odd.parquet"
    y = pa.array([Decimal(row) / 4 for row in range(ROWS)])
    write_table(pa.table({"a": list(range(ROWS)), "z": pa.nulls(ROWS), "y": y}), path)
    sample = choose(read_sheet(path), ["y"])
    assert sample.y[3, 0] == 0.75
    assert sample.remarks == ("Columns that are empty are left out: z.",)
    with pytest.raises(GivenError, match="column z is empty"):
        choose(read_sheet(path), ["z"])
    write_table(pa.Table.from_arrays([y, y], names=["a", "a"]), path)
    with pytest.raises(GivenError, match="two columns are called 'a'"):
        read_sheet(path)


@pytest.mark.parametrize(
    "dressed",
    ["1'234", "1 234", "1\u00a0234", "1\u202f234", "\u22121234", "12 %", "12%", "1 234,5"],
)
def test_numbers_as_people_write_them_are_numbers(tmp_path: Path, dressed: str) -> None:
    path = tmp_path / "people.csv"
    path.write_text(f"a;y\n{dressed};1\n7;2\n–;3\n", encoding="utf-8")
    plain = {"\u22121234": -1234.0, "12 %": 0.12, "12%": 0.12, "1 234,5": 1234.5}
    found = read_sheet(path).numbers["a"].tolist()
    assert found[:2] == [plain.get(dressed, 1234.0), 7.0] and np.isnan(found[2])


def test_no_date_and_no_two_numbers_in_a_cell_are_a_number(tmp_path: Path) -> None:
    path = tmp_path / "dates.csv"
    path.write_text("a;b;c;y\n2026-01-02;12 34;1 2345;1\n2026-01-03;56 78;2 3456;2\n")
    assert set(read_sheet(path).texts) == {"a", "b", "c"}


@pytest.mark.parametrize(
    "names", ["\u03b1,\u0434\u043b\u0438\u043d\u0430,\u91cd\u3055,\u00ff", "A,a,A a,\u00c4"]
)
def test_names_are_any_text(tmp_path: Path, table: Any, names: str) -> None:
    path = written(tmp_path / "names.csv", table)
    path.write_text(path.read_text().replace("a,b,c,y", names), encoding="utf-8")
    output = names.rpartition(",")[2]
    assert ",".join((*choose(read_sheet(path), [output]).factors, output)) == names


@pytest.mark.parametrize("asked", ["torque\n[Nm]", "torque [Nm]", " torque\r\n\t[Nm]"])
@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_name_that_goes_on_in_the_next_line_is_asked_for_either_way(
    tmp_path: Path, table: Any, kind: str, asked: str
) -> None:
    path = tmp_path / f"names.{kind}"
    if kind == "csv":
        written(path, table, '"bend\n(deg)",b,c,"torque\n[Nm]"')
    else:
        pa = pytest.importorskip("pyarrow")
        names = ["bend\n(deg)", "b", "c", "torque\n[Nm]"]
        from pyarrow.parquet import write_table

        write_table(pa.table(dict(zip(names, table.T, strict=True))), path)
    sample = choose(read_sheet(path), [asked], ["bend\n(deg)", "b"])
    assert (sample.outputs, sample.factors) == (("torque [Nm]",), ("bend (deg)", "b"))


def test_a_table_of_more_factors_and_outputs_than_can_be_waited_for_is_refused() -> None:
    names = [f"x{i}" for i in range(MOST_PAIRS // 2 + 3)]
    rng = np.random.default_rng(0)
    sheet = Sheet(
        file="wide.csv",
        columns=tuple(names),
        numbers={name: rng.random(FEWEST_ROWS) for name in names},
        texts={},
    )
    with pytest.raises(GivenError, match=r"501 factors and 2 outputs, .* 1000 at most: name those"):
        choose(sheet, ["x0", "x1"])
    assert len(choose(sheet, ["x0", "x1"], names[2:-1]).factors) == MOST_PAIRS // 2


def test_a_header_of_any_length_is_read_as_a_whole(tmp_path: Path) -> None:
    """The name that 64 KB cut, `c10`, was said to be that of two columns."""
    names = [f"c{number}" for number in range(12_000)]
    path = tmp_path / "wide.csv"
    path.write_text(f"{','.join(names)}\n" + f"{','.join('1' for _ in names)}\n" * 3)
    assert read_sheet(path).columns == tuple(names)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_a_long_table_keeps_the_letters_of_its_names(tmp_path: Path, encoding: str) -> None:
    """Of 64 KB and more in Latin-1 `Größe` became `Gre`."""
    path = tmp_path / "long.csv"
    path.write_bytes("Größe,y\n".encode(encoding) + b"1.25,2.5\n" * 10_000)
    assert read_sheet(path).columns == ("Größe", "y")


def test_a_header_longer_than_16_mb_is_refused_by_that(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"a_long_name_{number}" for number in range(1_000_000)))
    with pytest.raises(GivenError, match=r"its header is longer than 16 MB: keep fewer columns"):
        read_sheet(path)


def test_a_cell_without_end_is_refused_by_its_line(tmp_path: Path) -> None:
    """It was a parser's own words, of a limit that nobody knows."""
    path = tmp_path / "cell.csv"
    path.write_text(f"a,b,y\n{'1' * 500_000},2,3\n")
    with pytest.raises(GivenError, match="line 2 has a cell of more than 131072 characters"):
        read_sheet(path)


def test_a_column_that_is_left_out_costs_no_rows(tmp_path: Path) -> None:
    """`valid` was 1 or empty: a hundred of 200 rows went for it before it did."""
    rng = np.random.default_rng(1)
    lines = [f"{rng.random()},{'1' if n % 2 else ''},{rng.random()}" for n in range(200)]
    path = tmp_path / "valid.csv"
    path.write_text("\n".join(["a,valid,y", *lines]))
    sample = choose(read_sheet(path), ["y"])
    assert sample.factors == ("a",) and sample.complete.sum() == 200
    assert sample.remarks == ("Columns that do not vary are left out: valid.",)


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ('"0.5', "line 4 opens a quotation mark that nothing closes: close it, or take it away"),
        ('"0.5" x', "line 4 of column a reads '0.5 x', which is no number"),
        ("TRUE", "line 4 of column a reads 'TRUE', which is no number"),
    ],
)
def test_one_spoilt_cell_is_named_by_its_line(tmp_path: Path, cell: str, said: str) -> None:
    path = tmp_path / "spoilt.csv"
    lines = ["a,y", "0.1,0.2", "0.3,0.4", f"{cell},0.6", *["0.7,0.8"] * 60]
    path.write_text("\n".join(lines))
    with pytest.raises(GivenError, match=said) as caught:
        read_sheet(path)
    assert caught.value.line == 4 and "C error" not in str(caught.value)


def test_truths_are_numbers_beside_ones_and_noughts(tmp_path: Path) -> None:
    path = tmp_path / "truths.csv"
    path.write_text("a,y\nTRUE,1\n0,2\nfalse,3\n,4\n1,5\n")
    assert read_sheet(path).numbers["a"].tolist() == pytest.approx(
        [1, 0, 0, np.nan, 1], nan_ok=True
    )


@pytest.mark.parametrize(
    ("other", "times", "said"), [(-999.0, 3, True), (-999.0, 2, False), (-0.5, 9, False)]
)
def test_a_number_that_may_stand_for_none_is_named(
    tmp_path: Path, other: float, times: int, said: bool
) -> None:
    table = np.random.default_rng(1).random((100, 2))
    table[:times, 1] = other
    remarks = choose(read_sheet(written(tmp_path / "s.csv", table, "a,y")), ["y"]).remarks
    assert any("y is -999 in 3 rows" in remark for remark in remarks) == said
    assert sum("stands for no value" in remark for remark in remarks) == said


def test_one_value_in_many_rows_of_an_output_that_else_hardly_repeats_is_named(
    tmp_path: Path,
) -> None:
    table = np.random.default_rng(1).random((100, 2))
    for times, said in ((12, True), (4, False)):
        table[:times, 1] = 0.0
        table[times:12, 1] = 0.5 + table[times:12, 0]
        remarks = choose(read_sheet(written(tmp_path / "s.csv", table, "a,y")), ["y"]).remarks
        assert any("y is 0 in 12 of 100 rows" in remark for remark in remarks) == said
    table[:, 1] = np.floor(5.0 * table[:, 0])
    assert choose(read_sheet(written(tmp_path / "s.csv", table, "a,y")), ["y"]).remarks == ()


def test_an_output_that_loses_rows_to_the_gaps_of_another_is_named(tmp_path: Path) -> None:
    table = np.random.default_rng(1).random((100, 3))
    table[:9, 2] = np.nan
    sheet = read_sheet(written(tmp_path / "two.csv", table, "a,y,z"))
    (_, said) = choose(sheet, ["y", "z"]).remarks
    assert said.startswith(
        "Only the 91 rows are used that have all outputs: alone y would have 100"
    )
    assert len(choose(sheet, ["z"], ["a"]).remarks) == 1
