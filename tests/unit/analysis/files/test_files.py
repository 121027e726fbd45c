"""Files for other tools hold the same numbers as `results.csv`, bit for bit."""

import io
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyarrow as pa
import pytest

from analysis.designs import METHODS, instance_parameters, row_width
from analysis.files.netcdf import write_netcdf
from analysis.files.parquet import GROUP, STUDY_KEY, parquet, write_parquet
from analysis.files.results_csv import columns, read_table
from analysis.sensitivity.records import StudyPlan
from models.curves import Curve
from models.entries import RESULT_COLUMNS
from tests.testbed.studies import FACTORS, results_of, study_plan

UNITS = {"a": "m", "y": "Nm/rad"}
FAILED = [(0, 1), (2, 3)]


def described(plan: StudyPlan) -> dict[str, Any]:
    """Return the study as a coordinator shows it, as far as a file needs it."""
    factors = [{"name": name, "distribution": d.to_json()} for name, d in FACTORS.items()]
    return {
        "id": plan.id,
        "name": "größer als 1",
        "model": "two_outputs",
        "factors": factors,
        "outputs": list(plan.outputs),
    }


def lines_of(plan: StudyPlan) -> list[list[Any]]:
    """Return a study's results, without its last row, in the order of the columns."""
    lines: list[list[Any]] = []
    for result in results_of(plan, failed=FAILED):
        if result.row == plan.rows - 1:
            break
        point = instance_parameters(plan.method, plan.sampling, plan.seed, result.row, FACTORS)[
            result.position
        ]
        outputs = [result.outputs.get(name) for name in plan.outputs]
        line = [result.row, result.position, *point.values(), result.outcome, *outputs, 0.1, "pc"]
        lines.append(line)
    return lines


def write_csv(path: Path, plan: StudyPlan) -> Path:
    text = [columns(plan.factors, plan.outputs)] + [
        ["" if cell is None else repr(cell) if isinstance(cell, float) else cell for cell in line]
        for line in lines_of(plan)
    ]
    path.write_text("".join(",".join(map(str, line)) + "\n" for line in text))
    return path


@pytest.mark.parametrize("method", METHODS)
def test_parquet_holds_every_line_with_units_and_the_study(method: str, tmp_path: Path) -> None:
    plan = study_plan(method, rows=5)
    study = described(plan)
    write_parquet(tmp_path / "r.parquet", study, write_csv(tmp_path / "r.csv", plan), UNITS)
    table = pa.parquet.read_table(tmp_path / "r.parquet")
    names = columns(FACTORS, study["outputs"])
    assert table.column_names == names
    assert [list(row.values()) for row in table.to_pylist()] == lines_of(plan)
    assert json.loads(table.schema.metadata[STUDY_KEY]) == study
    units = {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata}
    assert units == UNITS
    width = row_width(plan.method, len(FACTORS))
    assert table["y"].null_count == sum(position < width for _, position in FAILED)


def test_a_long_parquet_file_comes_in_pieces() -> None:
    plan = study_plan("saltelli", rows=2)
    line = lines_of(plan)[0]
    taken: list[int] = []
    lines = (taken.append(i) or line for i in range(3 * GROUP))  # type: ignore[func-returns-value]

    pieces = parquet(described(plan), lines, {})
    begin = next(pieces)
    assert begin.startswith(b"PAR1") and len(taken) == GROUP
    whole = begin + b"".join(pieces)
    assert pa.parquet.read_metadata(io.BytesIO(whole)).num_rows == 3 * GROUP


def test_a_study_without_results_is_a_file_too(tmp_path: Path) -> None:
    plan = study_plan("morris", rows=1)
    study = described(plan)
    csv = write_csv(tmp_path / "r.csv", plan)
    write_parquet(tmp_path / "r.parquet", study, csv, UNITS)
    assert pa.parquet.read_table(tmp_path / "r.parquet").num_rows == 0
    write_netcdf(tmp_path / "r.nc", study, read_table(plan, csv), UNITS)
    with netCDF4.Dataset(tmp_path / "r.nc") as file:
        assert file["outcome"][:].mask.all()


def test_a_table_of_another_study_is_refused(tmp_path: Path) -> None:
    plan = study_plan("morris", rows=2)
    (tmp_path / "r.csv").write_text("row,position,a,outcome,y\n")
    with pytest.raises(ValueError, match="no table of study study: its columns are row, position"):
        write_parquet(tmp_path / "r.parquet", described(plan), tmp_path / "r.csv", UNITS)


@pytest.mark.parametrize("method", METHODS)
def test_netcdf_holds_rows_and_positions_for_an_independent_reader(
    method: str, tmp_path: Path
) -> None:
    plan = study_plan(method, rows=5)
    study = described(plan)
    table = read_table(plan, write_csv(tmp_path / "r.csv", plan))
    write_netcdf(tmp_path / "r.nc", study, table, UNITS)
    with netCDF4.Dataset(tmp_path / "r.nc") as file:
        width = row_width(method, len(FACTORS))
        assert {n: d.size for n, d in file.dimensions.items()} == {"row": 5, "position": width}
        assert json.loads(file.study) == study
        assert (file["a"].units, file["b"].units, file["y"].units) == ("m", "1", "Nm/rad")
        meanings = file["outcome"].flag_meanings.split()
        outcome = file["outcome"][:]
        assert outcome.mask[4].all() and not outcome.mask[:4].any()
        for line in lines_of(plan):
            named = dict(zip(columns(FACTORS, study["outputs"]), line, strict=True))
            at = (named["row"], named["position"])
            assert meanings[outcome[at]] == named["outcome"]
            for name in (*FACTORS, *plan.outputs):
                found = np.ma.filled(file[name][at], math.nan)
                assert found == named[name] or (named[name] is None and math.isnan(found))


def test_a_table_has_the_columns_that_no_model_may_call_its_own() -> None:
    assert columns((), ()) == list(RESULT_COLUMNS)


def test_the_axis_of_a_curve_is_kept_apart_from_a_factor_of_its_name(tmp_path: Path) -> None:
    made = study_plan("saltelli", rows=4)
    curve = Curve(points=2, over="time", low=0.5, high=2.0)
    factors = ("w_axis", *made.factors[1:])
    plan = replace(made, factors=factors, outputs=("w[0]", "w[1]"), curves={"w": curve})
    text = write_csv(tmp_path / "r.csv", made).read_text()
    header = ",".join(columns(factors, plan.outputs))
    (tmp_path / "r.csv").write_text("\n".join([header, *text.splitlines()[1:]]))
    table = read_table(plan, tmp_path / "r.csv")
    write_netcdf(tmp_path / "r.nc", described(plan) | {"outputs": ["w"]}, table, {})
    with netCDF4.Dataset(tmp_path / "r.nc") as file:
        assert file["w"].dimensions == ("row", "position", "w_axis_")
        assert file["w_axis_"][:].tolist() == [0.5, 2.0]
        assert file["w_axis"].dimensions == ("row", "position")


def test_a_curve_is_one_column_of_lists_and_one_variable_with_an_axis(tmp_path: Path) -> None:
    # Of the testbed's two outputs: the points of a curve of two.
    made = study_plan("saltelli", rows=4)
    curve = Curve(points=2, over="time", unit="s", low=0.5, high=2.0)
    lines = lines_of(made)
    plan = replace(made, outputs=("w[0]", "w[1]"), curves={"w": curve})
    study = described(plan) | {"outputs": ["w"], "curves": {"w": curve.as_json()}}
    csv = tmp_path / "r.csv"
    csv.write_text(write_csv(csv, made).read_text().replace(",y,z,", ",w[0],w[1],", 1))
    write_parquet(tmp_path / "r.parquet", study, csv, {"w": "Nm"})
    table = pa.parquet.read_table(tmp_path / "r.parquet")
    assert table.schema.field("w").metadata == {b"unit": b"Nm"}
    expected = [None if line[6] is None else line[6:8] for line in lines]
    assert table["w"].to_pylist() == expected and None in expected
    write_netcdf(tmp_path / "r.nc", study, read_table(plan, csv), {"w": "Nm"})
    with netCDF4.Dataset(tmp_path / "r.nc") as file:
        assert file["w"].dimensions == ("row", "position", "w_axis")
        assert (file["w"].units, file["w_axis"].units) == ("Nm", "s")
        assert file["w_axis"][:].tolist() == [0.5, 2.0]
        for line in lines:
            if line[6] is not None:
                assert file["w"][line[0], line[1]].tolist() == line[6:8]
