"""Bring a study's results into files that other tools read."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rehyb.client import Client, Json
from rehyb.errors import Invalid, RehybError, needs_extra
from rehyb.own_files import check_own
from rehyb.whole_files import whole_file

#: Formats by name, with the ending of their files.
FORMATS = {"csv": ".csv", "parquet": ".parquet", "netcdf": ".nc"}


def check_names(study: Json) -> None:
    """Raise Invalid unless the columns of a study's table can be told apart.

    Earlier versions took models of which they cannot.
    """
    from models.entries import DescriptionError, check_columns

    try:
        check_columns([factor["name"] for factor in study["factors"]], study["outputs"])
    except DescriptionError as error:
        raise Invalid(
            f"study {study['id']} gives its results.csv only, because of a name in its model: "
            f"{error}"
        ) from None


@contextmanager
def study_with_results(client: Client, study_id: str) -> Iterator[tuple[Json, Path]]:
    """Yield a study's description, and its results so far as CSV for as long as the block lasts.

    Raises:
        Invalid: a name in its model clashes with one in its table of results.
    """
    with tempfile.TemporaryDirectory() as folder:
        study, results = client.study(study_id), Path(folder) / "results.csv"
        check_names(study)
        client.results_csv(study_id, results)
        yield study, results


def export(client: Client, study_id: str, out: Path | None, format: str) -> Path:
    """Write a study's results so far as one file, and return its path.

    Args:
        out: the file; default: named after the study, in the current folder.
        format: one of FORMATS.

    Raises:
        Invalid: there is no such format.
        RehybError: the coordinator does not know the study or does not answer, what the format
            needs is not installed, or the file cannot be written.
    """
    if format not in FORMATS:
        raise Invalid(f"there is no format {format!r}: take one of {', '.join(FORMATS)}")
    path = out or Path(study_id + FORMATS[format])
    check_own(path, format)
    if format == "csv":
        client.results_csv(study_id, path)
        return path
    with whole_file(path) as partial, study_with_results(client, study_id) as (study, results):
        try:
            _write(partial, study, results, format)
        except RuntimeError as error:
            # The library of NetCDF says no more than "HDF error", of a full disk, too.
            raise RehybError(f"{path} cannot be written ({error}): is there room?") from error
    return path


def _write(path: Path, study: Json, results: Path, format: str) -> None:
    # Earlier versions did not tell them.
    units = study.get("units", {})
    with needs_extra(format, "files"):
        if format == "parquet":
            from analysis.files.parquet import write_parquet

            write_parquet(path, study, results, units)
        else:
            from analysis.files.netcdf import write_netcdf
            from analysis.files.results_csv import read_table
            from analysis.sensitivity.records import plan_of

            write_netcdf(path, study, read_table(plan_of(study), results), units)
