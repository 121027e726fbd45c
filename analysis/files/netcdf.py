"""A study's results as NetCDF: factors and outputs on the grid of rows and positions.

NetCDF-3 with 64-bit offsets (`scipy.io.netcdf_file`), which xarray, MATLAB, R and Julia read, with
names and attributes after the CF conventions (cfconventions.org, version 1.11).
"""

import json
from collections.abc import Container, Mapping
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from analysis.designs import row_width
from analysis.sensitivity.table import Table
from models.curves import Curve, columns, names_of

#: In `outcome`, where there is no result; in any other variable that is NaN.
MISSING = -1


def write_netcdf(
    path: Path, study: Mapping[str, Any], table: Table, units: Mapping[str, str]
) -> None:
    """Write factors, outputs and outcomes, each of shape (row, position), curves with an axis.

    `outcome` holds whole numbers whose names are in its attribute `flag_meanings`, ok first. Who
    computed a result, and how long it took, is in the CSV and Parquet files only.

    Args:
        study: as `GET /v1/studies/{id}` describes it; goes into the attribute `study` as JSON.
    """
    plan = table.plan
    shape = (plan.rows, row_width(plan.method, len(plan.units)))
    names = ["ok", *sorted(set(table.outcomes) - {"ok"})]
    outcome = np.full(shape, MISSING, dtype=np.int16)
    outcome[table.rows, table.positions] = [names.index(name) for name in table.outcomes]
    file = netcdf_file(path, "w", version=2)
    try:
        for dimension, size in zip(("row", "position"), shape, strict=True):
            file.createDimension(dimension, size)
            _put(file, dimension, np.arange(size, dtype=np.int32), (dimension,))
        written = {name: table.points[:, i] for i, name in enumerate(plan.factors)}
        written |= _outputs(table)
        for name, values in written.items():
            dimensions: tuple[str, ...] = ("row", "position")
            if name in plan.curves:
                dimensions = (*dimensions, _put_axis(file, name, plan.curves[name], written))
            grid = np.full((*shape, *values.shape[1:]), nan)
            grid[table.rows, table.positions] = values
            _put(
                file,
                name,
                grid,
                dimensions,
                long_name=name.replace("_", " "),
                units=units.get(name, "1"),
                kind="factor" if name in plan.factors else "output",
                _FillValue=np.float64(nan),
            )
        _put(
            file,
            "outcome",
            outcome,
            ("row", "position"),
            long_name="what became of the run",
            flag_values=np.arange(len(names), dtype=np.int16),
            flag_meanings=" ".join(names),
            _FillValue=np.int16(MISSING),
        )
        file.Conventions = b"CF-1.11"
        file.title = str(study["name"]).encode()
        file.study = json.dumps(study, sort_keys=True).encode()
    finally:
        file.close()


def _outputs(table: Table) -> dict[str, NDArray[np.float64]]:
    """Return the values of outputs by name, shape (lines,), or (lines, points) of a curve."""
    place = {column: o for o, column in enumerate(table.plan.outputs)}
    curves = table.plan.curves
    found = {}
    for name in names_of(table.plan.outputs, curves):
        if name in curves:
            found[name] = table.values[:, [place[p] for p in columns(name, curves[name].points)]]
        else:
            found[name] = table.values[:, place[name]]
    return found


def _put_axis(file: Any, name: str, curve: Curve, taken: Container[str]) -> str:
    """Write the axis of a curve and return the name of its dimension, which is none of `taken`."""
    dimension = f"{name}_axis"
    while dimension in taken:
        dimension += "_"
    file.createDimension(dimension, curve.points)
    _put(
        file,
        dimension,
        np.array(curve.axis()),
        (dimension,),
        long_name=curve.over.replace("_", " "),
        units=curve.unit,
    )
    return dimension


def _put(
    file: Any, name: str, values: NDArray[Any], dimensions: tuple[str, ...], **attributes: Any
) -> None:
    variable = file.createVariable(name, values.dtype, dimensions)
    variable[:] = values
    for attribute, value in attributes.items():
        setattr(variable, attribute, value.encode() if isinstance(value, str) else value)
