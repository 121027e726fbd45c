"""What rows that somebody else sampled tell."""

import json
import warnings
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from SALib.analyze import delta as salib_delta
from SALib.analyze import hdmr as salib_hdmr
from SALib.analyze import pawn as salib_pawn
from SALib.analyze import rbd_fast as salib_rbd_fast
from scipy.stats import qmc

from analysis.designs import unit_row
from analysis.given import hdmr, layout, measures
from analysis.given.answer import analyse, answer
from analysis.given.errors import GivenError
from analysis.given.hsic import hsic
from analysis.given.intervals import by_halves, half_width
from analysis.given.reading import read_sheet
from analysis.given.sample import choose
from analysis.given.spread import in_parts, quasi_random, sharing_nothing
from analysis.sensitivity.estimators import MorrisEstimator, SaltelliEstimator

ROWS = 88


def ishigami(u: Any) -> Any:
    x = (2.0 * u - 1.0) * np.pi
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


@pytest.fixture(scope="module")
def points() -> Any:
    return np.random.default_rng(5).random((ROWS, 3))


def written(path: Path, table: Any, names: str = "a,b,c,y", cell: str = "{:.17g}") -> Path:
    separator = ";" if ";" in names else ","
    lines = [separator.join(cell.format(value) for value in row) for row in table]
    path.write_text("\n".join([names, *lines] if names != ";" else lines))
    return path


@pytest.fixture(scope="module")
def table(points: Any) -> Any:
    return np.column_stack([points, ishigami(points)])


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory, table: Any) -> Any:
    path = written(tmp_path_factory.mktemp("given") / "runs.csv", table)
    return analyse(path, ["y"])


def test_each_index_is_that_of_salib(points: Any) -> None:
    y = ishigami(points)
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0, 1]] * 3}
    first = salib_rbd_fast.analyze(problem, points, y, num_resamples=2)["S1"]
    assert measures.rbd_fast(points, y) == pytest.approx(np.array(first), abs=1e-6)
    ranks = np.argsort(np.argsort(points, axis=0), axis=0).astype(float)
    median = salib_pawn.analyze(problem, ranks, y)["median"]
    assert measures.pawn(points, y) == pytest.approx(np.array(median), abs=1e-6)
    power = 2.0 / (7.0 + np.tanh((1500.0 - ROWS) / 500.0))
    edges = np.linspace(0, ROWS, int(np.ceil(ROWS**power)) + 1)
    grid = np.linspace(y.min(), y.max(), 100)
    found = [salib_delta.calc_delta(y, grid, column, edges) for column in points.T]
    assert measures.delta(points, y) == pytest.approx(np.array(found), abs=1e-6)


def test_hdmr_is_that_of_salib_less_what_as_many_coefficients_fit_by_chance() -> None:
    x = np.random.default_rng(8).random((300, 3))
    y = ishigami(x)
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0, 1]] * 3}
    with warnings.catch_warnings(action="ignore"):
        # Their fit goes on until coefficients move by less than 0.001, whatever the output's unit.
        theirs = salib_hdmr.analyze(problem, x, 1e4 * y, maxorder=1, K=1, m=5, maxiter=1000)["S"]
    assert hdmr.shares(x, y) == pytest.approx(theirs, abs=1e-6)
    independent = np.random.default_rng(9).normal(size=(200, 300))
    by_chance = np.mean([hdmr.hdmr(x, noise) for noise in independent], axis=0)
    assert by_chance == pytest.approx(np.zeros(3), abs=0.01)


def test_hdmr_counts_for_each_factor_what_it_shares_with_another() -> None:
    """Of a + b each has half the variance, of which a part is its own and a part is both's."""
    rng = np.random.default_rng(10)
    x = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.8], [0.8, 1.0]], 2000)
    assert hdmr.hdmr(x, x.sum(axis=1)) == pytest.approx([0.5, 0.5], abs=0.02)
    assert hdmr.hdmr(x, x[:, 0]) == pytest.approx([1.0, 0.0], abs=0.02)


def test_of_too_few_rows_for_its_splines_hdmr_is_withheld(tmp_path: Path) -> None:
    x = np.random.default_rng(11).random((64, 3))
    found = analyse(written(tmp_path / "few.csv", np.column_stack([x, ishigami(x)])), ["y"])
    assert "hdmr is withheld: of 3 factors it takes 88 rows." in found["remarks"]
    assert found["outputs"]["y"]["measures"]["hdmr"]["a"]["value"] is None


def test_hsic_and_its_test_are_those_of_openturns(points: Any) -> None:
    ot = pytest.importorskip("openturns")
    x, y = points[:40], ishigami(points[:40])
    kernels = []
    for column in (*x.T, y):
        kernel = ot.SquaredExponential(1)
        kernel.setScale([float(column.std(ddof=1))])
        kernels.append(kernel)
    theirs = ot.HSICEstimatorGlobalSensitivity(
        kernels, ot.Sample(x), ot.Sample(y[:, None]), ot.HSICUStat()
    )
    ours = hsic(x, y)
    assert ours.r2 == pytest.approx(np.array(theirs.getR2HSICIndices()), abs=1e-6)
    assert ours.p_value == pytest.approx(np.array(theirs.getPValuesAsymptotic()), abs=1e-6)


def test_halves_of_a_mean_give_its_standard_error() -> None:
    rng = np.random.default_rng(1)
    y = rng.normal(size=4000)

    def mean(x: Any, y: Any) -> Any:
        return np.array([y.mean()])

    variance = by_halves(mean, np.zeros((4000, 1)), y, rng)
    half = half_width(variance, np.zeros(1), 0.9)
    assert half[0] == pytest.approx(1.746 / np.sqrt(4000.0), rel=0.5)


def test_what_chance_adds_is_counted_once_and_takes_half_of_the_variance_at_most() -> None:
    added = np.array([0.0, 1.0, 3.0])
    half = half_width(np.full(3, 4.0), added, 0.9)
    assert half**2 / half[0] ** 2 == pytest.approx([1.0, 0.75, 0.5])


def test_every_measure_has_an_interval_and_says_what_it_assumes(answered: Any) -> None:
    assert list(answered["measures"]) == ["rbd_fast", "hdmr", "delta", "pawn", "hsic"]
    for name, about in answered["measures"].items():
        assert about["assumes"] and about["source"] and about["rows"] == ROWS
        for entry in answered["outputs"]["y"]["measures"][name].values():
            assert entry["low"] <= entry["value"] <= entry["high"]


def test_the_test_of_independence_finds_what_the_variance_misses(points: Any) -> None:
    rng = np.random.default_rng(2)
    x = rng.random((400, 2))
    # The mean does not depend on the first factor, the spread does; nothing on the second.
    y = (0.1 + x[:, 0]) * rng.normal(size=400)
    found = hsic(x, y)
    assert found.p_value[0] < 1e-4 < 0.05 < found.p_value[1]
    assert abs(measures.rbd_fast(x, y)[0]) < 0.1


def test_units_do_not_matter(tmp_path: Path, table: Any, answered: Any) -> None:
    scaled = table * [1e9, 1e-9, 1.0, 1e80] + [1e5, 0.0, 3.0, 0.0]
    found = analyse(written(tmp_path / "runs.csv", scaled), ["y"])["outputs"]["y"]["measures"]
    for name, of_factors in answered["outputs"]["y"]["measures"].items():
        for factor, entry in of_factors.items():
            assert found[name][factor] == pytest.approx(entry, abs=1e-6)


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


def test_truths_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    path.write_text("on,y\n" + "TRUE,1\nfalse,2\n" * 40)
    assert set(read_sheet(path).numbers["on"]) == {0.0, 1.0}


@pytest.mark.parametrize("rare", [1, 3])
def test_a_rare_event_of_few_levels_has_an_answer_in_json(tmp_path: Path, rare: int) -> None:
    rng = np.random.default_rng(4)
    x = np.column_stack([rng.integers(0, 2, 70), rng.integers(0, 3, 70), np.arange(70) // 69])
    y = (np.arange(70) < rare).astype(float)
    path = written(tmp_path / "rare.csv", np.column_stack([x, y]))
    found = analyse(path, ["y"])
    json.dumps(found, allow_nan=False)
    assert "Factors of few values" in " ".join(found["remarks"])
    assert set(found["outputs"]["y"]["measures"]) == set(found["measures"])


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
    assert "a and a2 (+1.00)" in said


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


def saltelli(rows: int, k: int = 3) -> Any:
    return np.stack([unit_row("saltelli", "sobol_blocks", 4, row, k) for row in range(rows)])


def test_a_saltelli_design_of_any_order_is_recognised_and_estimated() -> None:
    design = saltelli(8)
    ours = SaltelliEstimator(sampling="latin_hypercube", seed=0, factors=3, outputs=1)
    ours.add_rows(range(8), ishigami(design.reshape(-1, 3)).reshape(8, 5, 1))
    for arranged in (design, design[:, [0, 2, 3, 4, 1]], design.swapaxes(0, 1)):
        x = arranged.reshape(-1, 3)
        found = layout.recognise(x)
        assert found is not None and found.method == "saltelli"
        indices = layout.indices(found, x, ishigami(x)[:, None], 0.9)
        for name, index in ours.indices(0.9).items():
            assert np.array_equal(indices[name].value, index.value)
        independent = x[found.independent].reshape(2, 8, 3)
        assert np.array_equal(independent, design[:, :2].swapaxes(0, 1))


@pytest.mark.parametrize("sampling", ["sobol", "trajectories"])
def test_a_morris_design_is_recognised_and_estimated(sampling: str) -> None:
    x = np.concatenate([unit_row("morris", sampling, 4, row, 3) for row in range(12)])
    found = layout.recognise(x)
    assert found is not None and found.method == "morris"
    y = np.stack([2.0 * x[:, 0] - x[:, 1], x[:, 2] ** 2], axis=1)
    reach = np.ptp(x, axis=0)
    effects = layout.indices(found, x, y, 0.9)["mu"].value
    assert effects[0] == pytest.approx([2.0 * reach[0], -reach[1], 0.0])
    ours = MorrisEstimator(sampling=sampling, seed=4, factors=3, outputs=2)
    ours.add_rows(range(12), y.reshape(12, 4, 2))
    assert effects == pytest.approx(ours.indices(0.9)["mu"].value * reach)


def test_no_design_is_seen_in_random_points(points: Any) -> None:
    assert layout.recognise(points) is None
    x = saltelli(8).reshape(-1, 3)
    assert layout.recognise(np.roll(x, 1, axis=0)) is None


def test_of_a_design_only_points_that_share_nothing_count_as_a_sample(tmp_path: Path) -> None:
    x = saltelli(40).reshape(-1, 3)
    path = written(tmp_path / "design.csv", np.column_stack([x, ishigami(x)]))
    found = answer(choose(read_sheet(path), ["y"]))
    assert found["design"] == {"method": "saltelli", "rows": 40, "width": 5}
    assert found["measures"]["pawn"]["rows"] == 80
    assert set(found["outputs"]["y"]["design"]) == {"first_order", "total_order"}


def test_a_full_factorial_in_its_natural_order_has_no_related_factors(tmp_path: Path) -> None:
    grid = np.array(list(np.ndindex(5, 5, 5)), dtype=float)
    path = written(tmp_path / "grid.csv", np.column_stack([grid, grid.sum(axis=1)]))
    assert "depend" not in " ".join(choose(read_sheet(path), ["y"]).remarks)


@pytest.mark.parametrize(
    ("engine", "rows"), [(qmc.Sobol, 128), (qmc.Sobol, 250), (qmc.Halton, 256)]
)
def test_points_of_a_sequence_are_told_from_drawn_ones(engine: Any, rows: int) -> None:
    with warnings.catch_warnings(action="ignore"):
        points = engine(4, seed=3).random(rows)
    shuffled = np.random.default_rng(3).permutation(points)[: rows - rows // 40] ** 2
    assert quasi_random(points) and quasi_random(np.column_stack([shuffled, shuffled[:, 0]]))
    assert not quasi_random(qmc.LatinHypercube(4, seed=3).random(rows))
    assert not quasi_random(np.random.default_rng(3).random((rows, 4)))


def test_of_sobol_points_rbd_fast_is_withheld_and_why_is_said(tmp_path: Path) -> None:
    x = qmc.Sobol(3, seed=2).random(64)
    found = analyse(written(tmp_path / "s.csv", np.column_stack([x, ishigami(x)])), ["y"])
    of_y = found["outputs"]["y"]["measures"]
    assert of_y["rbd_fast"]["a"] == {"value": None, "low": None, "high": None}
    assert of_y["delta"]["a"]["value"] > 0.0
    assert "rbd_fast is withheld" in " ".join(found["remarks"])


def test_copies_of_rows_tell_nothing_new(tmp_path: Path, table: Any) -> None:
    sample = choose(read_sheet(written(tmp_path / "c.csv", np.tile(table, (3, 1)))), ["y"])
    assert np.array_equal(sample.x, table[:, :3])
    assert f"{2 * ROWS} of {3 * ROWS} rows are exact copies" in sample.remarks[0]
    holes = np.vstack([table, np.full((3, 4), np.nan)])
    sample = choose(read_sheet(written(tmp_path / "c.csv", holes)), ["y"])
    assert (
        "copies" not in sample.remarks[0]
        and f"3 of {ROWS + 3} rows lack a cell" in sample.remarks[0]
    )
    with pytest.raises(GivenError, match="it has 40 different rows, and not the 64"):
        choose(read_sheet(written(tmp_path / "c.csv", np.tile(table[:40], (3, 1)))), ["y"])


def test_equal_rows_of_few_values_are_no_copies(tmp_path: Path) -> None:
    x = np.random.default_rng(4).integers(0, 3, (80, 2)).astype(float)
    sample = choose(read_sheet(written(tmp_path / "d.csv", x, "a,y")), ["y"])
    assert len(sample.x) == 80


def test_parts_of_a_design_are_seen_in_any_order_and_thinned(tmp_path: Path) -> None:
    x = np.random.default_rng(6).permutation(saltelli(80).reshape(-1, 3))[:-3]
    assert in_parts(x) > 200
    apart = x[sharing_nothing(x)]
    assert all(len(np.unique(column)) == len(apart) for column in apart.T)
    found = answer(
        choose(read_sheet(written(tmp_path / "p.csv", np.column_stack([x, ishigami(x)]))), ["y"])
    )
    assert "give every line of it, in its order" in " ".join(found["remarks"])
    assert found["measures"]["pawn"]["rows"] == len(apart)


def test_drawn_rounded_and_crossed_points_are_no_parts_of_a_design(points: Any) -> None:
    grid = np.array(list(np.ndindex(5, 5, 5)), dtype=float)
    for x in (points, points.round(1), grid):
        assert in_parts(x) == 0


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


def test_numbers_too_small_for_their_squares_are_one_sentence(tmp_path: Path, table: Any) -> None:
    path = written(tmp_path / "tiny.csv", table * [1.0, 1.0, 1.0, 1e-310])
    with pytest.raises(GivenError, match=r"column y has no number beyond ±1e-100"):
        read_sheet(path)


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
