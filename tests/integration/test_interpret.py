"""From a bank to K_h with an interval, by the commands that a clinic types."""

import json
import shutil
import tempfile
from errno import ENOSPC
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rehyb import Client
from rehyb.cli import app, main
from rehyb.client.packing import packed
from rehyb.errors import Invalid
from sim.assessment.assess import assess
from tests.testbed.fleet.warm import WarmFleet
from tests.testbed.interpretation import written_session
from worker.banks import usable_bank
from worker.close_loop.child import work

RUNNER = CliRunner()


def run(*arguments: str) -> Any:
    result = RUNNER.invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bank") / "bank.npz"
    small = ("--contact-rows", "0", "--processes", "1", "--out", str(path))
    first = run("bank", "build", "--rows", "170", *small)
    more = run("bank", "build", "--rows", "180", "--extend", *small)
    failed = sum(more["bushing"]["failed"].values())
    assert more["bushing"]["recordings"] + failed == 180
    assert more["id"] != first["id"]
    assert run("bank", "show", "--bank", str(path))["id"] == more["id"]
    return path


def test_a_recording_is_interpreted_and_reported(bank: Path, tmp_path: Path) -> None:
    recorded = str(tmp_path / "a.npz")
    patient = (
        "activation=0.05",
        "muscles=physiological",
        "passive_stiffness=3",
        "seat_angle=-0.05",
    )
    settings = [part for one in patient for part in ("--set", one)]
    truth = run("assess", "--fidelity", "bushing", *settings, "--record", recorded)
    page = tmp_path / "a.html"
    asked = ("interpret", recorded, "--bank", str(bank))
    found = run(
        *asked, "--known", "forearm_mass=0.962:0.1", "--tolerance", "0.3", "--out", str(page)
    )
    low, high = found["stiffness"]["interval90"]
    # 180 rows say little, but they say where it is.
    assert low - 1.0 < -truth["stiffness_sum"] < high + 1.0
    assert found["known"] == [{"name": "forearm_mass", "value": 0.962, "sd": 0.1}]
    assert {"damping", "stiffness_over_angle", "parts", "next", "bank"} <= set(found)
    assert page.read_text().startswith("<!DOCTYPE html>")
    # An answer is there although its report cannot be written.
    for text in ((), ("--json",)):
        lost = RUNNER.invoke(app, [*asked, *text, "--out", str(tmp_path / "nowhere" / "a.html")])
        assert isinstance(lost.exception, OSError)
        assert ("interval90" if text else "90 %:") in lost.stdout and "nowhere" not in lost.stdout
    lines = RUNNER.invoke(app, list(asked)).stdout
    assert "90 %:" in lines
    assert "all this whatever the limb's muscles are; if they are one of the bank's sets:" in lines


def test_a_full_disk_leaves_no_half_of_a_record_or_page(
    bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(*given: Any) -> None:
        next(one for one in given if isinstance(one, Path)).write_bytes(b"half")
        raise OSError(ENOSPC, "No space left on device")

    record, page = str(tmp_path / "a.npz"), str(tmp_path / "a.html")
    simulate = ["assess", "--fidelity", "bushing", "--record", record]
    with monkeypatch.context() as full:
        full.setattr("sim.assessment.record.Record.save", half)
        lost = RUNNER.invoke(app, simulate)
        assert isinstance(lost.exception, OSError) and record in str(lost.exception)
    assert list(tmp_path.iterdir()) == []
    assert RUNNER.invoke(app, simulate).exit_code == 0
    monkeypatch.setattr("analysis.interpretation.page.write_page", half)
    lost = RUNNER.invoke(app, ["interpret", record, "--bank", str(bank), "--out", page])
    assert isinstance(lost.exception, OSError) and page in str(lost.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_bank_whose_extension_is_interrupted_stays_as_it_was(
    bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path(shutil.copy(bank, tmp_path / "bank.npz"))

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("analysis.interpretation.build.sample", interrupted)
    more = ["bank", "build", "--extend", "--rows", "181", "--contact-rows", "0"]
    assert RUNNER.invoke(app, [*more, "--out", str(path)]).exit_code != 0
    assert path.read_bytes() == bank.read_bytes()
    help_text = " ".join(RUNNER.invoke(app, ["bank", "build", "--help"]).output.split())
    assert "interrupted, it stays as it was, and what was simulated is lost" in help_text


@pytest.mark.parametrize("out", ["nodir/x.npz", "/proc/x.npz", "."])
def test_a_bank_that_cannot_be_written_is_refused_before_anything_is_simulated(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def simulated(*_: object, **__: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("analysis.interpretation.build.sample", simulated)
    monkeypatch.setattr("sys.argv", ["rehyb", "bank", "build", "--out", out])
    with pytest.raises(SystemExit) as leaving:
        main()
    assert leaving.value.code == 2 and capsys.readouterr().err.startswith(f"rehyb: {out}")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """A zipped session of one movement."""
    record = assess({"activation": 0.05}, fidelity="bushing").record
    assert record is not None
    (tmp_path / "monday").mkdir()
    with packed(written_session(tmp_path / "monday", record)) as packed_one:
        return Path(shutil.copy(packed_one, tmp_path / "monday.zip"))


def job(archive: Path, bank: Path, **options: Any) -> dict[str, Any]:
    wanted = {"known": [], "tolerance": None, "bank": None, **options}
    parameters = {"archive": str(archive), "bank": str(bank), "options": wanted}
    return {"id": "j", "model": "interpretation", "parameters": parameters}


def test_a_worker_interprets_a_session_by_its_bank(
    bank: Path, archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(archive.parent)
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setenv("REHYB_BANK", str(bank))
    there = usable_bank(None)
    assert there is not None and there[1] == bank
    known = [{"name": "forearm_mass", "value": 0.96, "sd": 0.1}]
    done = work(job(archive, bank, known=known, tolerance=0.3))
    assert (done.outcome, done.state) == ("ok", {"bank": there[0]})
    found = json.loads((archive.parent / "out" / "report.json").read_text())
    assert found["known"] == known and found["tolerance"]["value"] == 0.3
    assert "Stiffness of the elbow" in (archive.parent / "out" / "report.html").read_text()


def test_what_a_worker_cannot_interpret_is_one_sentence(
    bank: Path, archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(archive.parent)
    monkeypatch.setattr(tempfile, "tempdir", None)
    known = [{"name": "forearm_mass", "value": 960.0, "sd": 0.1}]
    done = work(job(archive, bank, known=known))
    assert done.outcome == "bad_session"
    assert "forearm_mass cannot be 960 kg" in (done.reason or "")


def test_a_worker_leaves_at_once_if_the_bank_it_is_given_is_none(tmp_path: Path) -> None:
    (tmp_path / "bank.npz").write_bytes(b"PK")
    with pytest.raises(Invalid, match="is no bank"):
        usable_bank(tmp_path / "bank.npz")


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        ("forearm_mass=0.9", "name=value:sd"),
        ("forearm_mass", "name=value"),
        ("forearm_mass=heavy:1", "must be a number"),
    ],
)
def test_a_known_value_without_its_accuracy_is_one_sentence(known: str, sentence: str) -> None:
    result = RUNNER.invoke(app, ["interpret", "a.npz", "--known", known])
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())


def test_what_a_command_would_pass_over_is_one_sentence() -> None:
    for wrong, sentence in (
        (("interpret", "a.npz", "--out", "a.pdf"), "--out writes a page: name it .html, not a.pdf"),
        (("bank", "build", "--extend", "--seed", "1", "--out", "b"), "leave --population, --with-"),
        (("bank", "build", "--contact-rows", "10", "--out", "b"), "10 rows with contact are too"),
    ):
        result = RUNNER.invoke(app, [*wrong])
        assert isinstance(result.exception, Invalid) and sentence in str(result.exception)


def test_a_fleet_samples_a_bank_and_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("analysis.interpretation.build.LEAST_CONTACT", 2)
    path = tmp_path / "bank.npz"
    with (
        WarmFleet(tmp_path / "fleet", workers=2) as fleet,
        Client(fleet.url, fleet.token) as client,
    ):
        there = ("--submit", "--url", fleet.url, "--token", fleet.token, "--out", str(path))
        first = run("bank", "build", "--rows", "160", "--contact-rows", "2", *there)
        # The coordinator has them: nothing is simulated again, and two rows more.
        more = run("bank", "build", "--rows", "162", "--contact-rows", "2", *there)
        rows = {study["model"]: study["rows"] for study in client.studies()}
    assert rows == {"elbow_bushing_recording": 162, "elbow_recording": 2}
    for bank, levels in ((first, (160, 2)), (more, (162, 2))):
        counted = [bank[level] for level in ("bushing", "contact")]
        assert [one["recordings"] + sum(one["failed"].values()) for one in counted] == [*levels]
    assert (
        more["id"] != first["id"] and run("bank", "show", "--bank", str(path))["id"] == more["id"]
    )


def test_what_a_bank_of_a_fleet_cannot_be_told_is_one_sentence(tmp_path: Path) -> None:
    for wrong, sentence in (
        (("--submit", "--extend"), "leave --extend and --processes out"),
        (("--url", "http://127.0.0.1:9"), "--url and --token go with --submit"),
        (("--submit", "--rows", "8", "--url", "http://127.0.0.1:9", "--token", "t"), "too few"),
    ):
        result = RUNNER.invoke(app, ["bank", "build", "--out", str(tmp_path / "b"), *wrong])
        assert isinstance(result.exception, Invalid) and sentence in str(result.exception)
