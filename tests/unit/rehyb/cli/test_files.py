"""Files about a study are written whole or not at all, and a check says what does not hold."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import netCDF4
import pytest
from pyarrow import parquet

from tests.testbed.coordinators.finished_study import FinishedStudy

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def coordinator(
    talk_to: Callable[[FinishedStudy], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> FinishedStudy:
    """A coordinator that has the study; the command runs in an empty folder."""
    monkeypatch.chdir(tmp_path)
    coordinator = FinishedStudy()
    talk_to(coordinator)
    return coordinator


def test_results_are_exported_in_three_formats(
    run: Run, coordinator: FinishedStudy, tmp_path: Path
) -> None:
    assert run("study", "export", "s1") == (0, "s1.csv\n", "")
    assert run("study", "export", "s1", "--format", "parquet", "--out", "r.parquet")[0] == 0
    assert json.loads(run("study", "export", "s1", "--format", "netcdf", "--json")[1]) == {
        "file": "s1.nc"
    }
    assert (tmp_path / "s1.csv").read_text() == coordinator.table()
    y = [one.outputs.get("y") for one in coordinator.results]
    assert parquet.read_table(tmp_path / "r.parquet")["y"].to_pylist() == y
    with netCDF4.Dataset(tmp_path / "s1.nc") as file:
        assert file["y"][:].ravel().tolist() == y
        assert json.loads(file.study)["id"] == "s1"
    assert {path.name for path in tmp_path.iterdir()} == {"s1.csv", "r.parquet", "s1.nc"}


@pytest.mark.usefixtures("coordinator")
def test_a_format_that_cannot_be_written_is_one_sentence_and_no_file(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    status, _, err = run("study", "export", "s1", "--format", "excel")
    assert (status, err) == (
        2,
        "rehyb: there is no format 'excel': take one of csv, parquet, netcdf\n",
    )
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    status, _, err = run("study", "export", "s1", "--format", "parquet")
    assert (status, err) == (1, "rehyb: parquet needs pyarrow: pip install 'rehyb[files]'\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("coordinator")
def test_netcdf_that_cannot_be_written_is_one_sentence_and_no_file(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As on a full disk, of which its library does not tell."""

    def fail(*_: object) -> None:
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("analysis.files.netcdf.write_netcdf", fail)
    assert run("study", "export", "s1", "--format", "netcdf") == (
        1,
        "",
        "rehyb: s1.nc cannot be written (NetCDF: HDF error): is there room?\n",
    )
    assert list(tmp_path.iterdir()) == []


def test_a_bundle_is_written_checked_and_submitted_again(
    run: Run, coordinator: FinishedStudy, tmp_path: Path
) -> None:
    status, out, _ = run("bundle", "s1")
    assert status == 0 and out.startswith("s1.zip\nSHA-256 ")
    status, out, err = run("reproduce", "s1.zip", "--check", "--sample", "3")
    assert (status, err) == (0, "")
    assert [line[:15] for line in out.splitlines()] == [
        "ok      hashes:",
        "ok      design:",
        "ok      failure",
        "ok      indices",
        "ok      runs: 3",
    ]
    assert run("reproduce", "s1.zip") == (0, "s2  try: 30 instances\n", "")
    assert json.loads(coordinator.submitted[0])["seed"] == 5


def test_what_does_not_hold_is_exit_status_1_and_what_is_no_bundle_2(
    run: Run, coordinator: FinishedStudy, tmp_path: Path
) -> None:
    # A coordinator that made up a result after it had computed the indices.
    coordinator.results[0].outputs["y"] += 1.0  # type: ignore[index]
    assert run("bundle", "s1", "--out", "b.zip", "--json")[0] == 0
    status, out, _ = run("reproduce", "b.zip", "--check", "--sample", "30", "--json")
    answer = json.loads(out)
    assert (status, answer["holds"]) == (1, False)
    assert [one["check"] for one in answer["findings"] if not one["holds"]] == ["indices", "runs"]
    (tmp_path / "b.zip").write_bytes(b"PK")
    status, _, err = run("reproduce", "b.zip", "--check")
    assert status == 2
    assert err == "rehyb: b.zip is no bundle, or is damaged: File is not a zip file\n"
    assert run("reproduce", "no.zip", "--check") == (
        2,
        "",
        "rehyb: no.zip: No such file or directory\n",
    )


@pytest.mark.parametrize(("yes", "submitted"), [((), 0), (("--yes",), 1)])
def test_a_bundle_of_a_study_of_very_many_instances_is_asked_about(
    yes: tuple[str, ...],
    submitted: int,
    run: Run,
    coordinator: FinishedStudy,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A stranger's bundle said 99999999 rows, and its reproduction took half a thousand million."""
    assert run("bundle", "s1", "--out", "s1.zip")[0] == 0
    with zipfile.ZipFile("s1.zip") as honest, zipfile.ZipFile("many.zip", "w") as forged:
        for name in honest.namelist():
            content = honest.read(name).replace(b'"rows": 6', b'"rows": 99999999')
            forged.writestr(name, content)
    asked: list[object] = []
    monkeypatch.setattr(
        "rehyb.client.Client.submit",
        lambda _, study: (asked.append(study), {**study, "id": "s2", "instances": 1})[1],
    )
    status, _, err = run("reproduce", "many.zip", *yes)
    assert len(asked) == submitted
    if not yes:
        assert status == 2 and "499,999,995 instances" in err and "say --yes" in err
    checked = run("reproduce", "many.zip", "--check", "--sample", "0")
    assert checked[0] == 1 and "of 30 results (of 499,999,995 instances)" in checked[1]
