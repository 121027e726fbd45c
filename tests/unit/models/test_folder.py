"""A model's folder is read, packed and unpacked, and what is wrong in it is one sentence."""

import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from models.folder import LIMITS, ModelError, copied, pack, read_folder, unpacked_into
from tests.testbed.models import EXAMPLES, edited

NO_JSON = "goes to the server as JSON, which has no dates, inf or nan"


def test_a_folder_packed_and_unpacked_is_the_same_version(tmp_path: Path) -> None:
    read = read_folder(EXAMPLES / "pendulum")
    pack(read, tmp_path / "pendulum.zip")
    (tmp_path / "out").mkdir()
    again = read_folder(unpacked_into(tmp_path / "pendulum.zip", tmp_path / "out"))
    assert again.description == read.description
    assert again.description.version.startswith("pendulum@")


def test_another_file_beside_it_is_another_version_and_a_cache_is_none(tmp_path: Path) -> None:
    folder = edited("ishigami_python", tmp_path)
    before = read_folder(folder).description.digest
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "ishigami.pyc").write_bytes(b"x")
    assert read_folder(folder).description.digest == before
    (folder / "data.csv").write_text("1")
    assert read_folder(folder).description.digest != before


def test_a_byte_order_mark_is_no_part_of_it(tmp_path: Path) -> None:
    folder = edited("pendulum", tmp_path)
    path = folder / "model.toml"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read_folder(folder).description.factors


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "mjcf"', 'kind = "fmu"', "expected mjcf, command or umbridge"),
        ('kind = "mjcf"', 'kind = "command"', "is unknown: expected model, factors, outputs"),
        ("[model]", "[modell]", "must have a table [model]"),
        ("low = 5.0", "low = 50.0", "factors[0].high: 20 must lie above low, 50 (stiffness)"),
        ("low = 5.0", "low = ", "is not TOML"),
        ("[[factors]]", "[[factor]]", "is unknown"),
        ("time_limit = 60", ".".join(["a"] * 9000) + " = 1", "a line of more than 2000"),
    ],
)
def test_what_is_wrong_in_it_is_one_sentence(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    folder = edited("pendulum", tmp_path, {old: new})
    with pytest.raises(ModelError) as caught:
        read_folder(folder)
    assert words in str(caught.value)
    assert str(caught.value).startswith("model.toml: ")


@pytest.mark.parametrize(
    ("old", "new", "over", "unit", "ends"),
    [
        ("", "", "time", "s", (0.0, 0.5)),
        ('over = "time"\n', "", "time", "s", (0.0, 0.5)),
        ("duration = 0.5", "duration = 2\nrecord_from = 1.5", "time", "s", (1.5, 2.0)),
        ('over = "time"', 'over = "elbow.position"', "elbow.position", "1", (0.0, 1.0)),
        # What is wrong with these, whoever reads them says.
        ("duration = 0.5", "", "time", "1", (0.0, 1.0)),
        ("duration = 0.5", 'duration = 2\nrecord_from = "x"', "time", "1", (0.0, 1.0)),
        ("duration = 0.5", "duration = 0.5\nrecord_from = 0.5", "time", "1", (0.0, 1.0)),
    ],
)
def test_a_curve_of_a_sensor_lies_over_what_is_recorded_of_time_or_over_another_sensor(
    tmp_path: Path, old: str, new: str, over: str, unit: str, ends: tuple[float, float]
) -> None:
    folder = edited("robot", tmp_path, {old: new} if old else {})
    axis = read_folder(folder).description.curves["elbow_over_time"]
    assert (axis.points, axis.over, axis.unit, (axis.low, axis.high)) == (11, over, unit, ends)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("time_limit = 60", "#" * 1999 + "\n" * 500_001, "model.toml: is larger than 500 kB"),
        ("time_limit = 60", "x = " + "[" * 1990, "model.toml: is nested too deeply"),
    ],
)
def test_a_description_of_no_sense_is_told_whole(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    folder = edited("pendulum", tmp_path, {old: new})
    with pytest.raises(ModelError) as caught:
        read_folder(folder)
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'run = ["python3", "ishigami.py"]',
            'run = "python3 ishigami.py"',
            "command.run is 'python3 ishigami.py': expected a list of texts, as [\"python3\", ",
        ),
        ('run = ["python3", "ishigami.py"]', "run = []", "command.run is '[]': expected a list"),
        ('run = ["python3", "ishigami.py"]', "", "command.run is missing: expected a list"),
        ("keep = true", 'keep = "yes"', "command.keep must be true or false"),
        ("keep = true", "kept = true", "command.kept is unknown: expected keep, run"),
    ],
)
def test_how_a_program_is_run_is_looked_at_when_its_model_is_read(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    folder = edited("ishigami_python", tmp_path, {old: new})
    with pytest.raises(ModelError) as caught:
        read_folder(folder)
    assert str(caught.value).startswith(f"model.toml: {words}")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("name = 3", "umbridge.name must be a text: what the server calls its model"),
        ("config = 3", "umbridge.config must be a table, which the server gets as it is"),
        ("config = {day = 2026-01-01}", f"umbridge.config {NO_JSON}"),
        ("config = {most = inf}", f"umbridge.config {NO_JSON}"),
        ('url = "http://h"', "umbridge.url is unknown: expected config, name"),
    ],
)
def test_what_a_server_is_asked_for_is_looked_at_when_its_model_is_read(
    tmp_path: Path, said: str, words: str
) -> None:
    folder = edited("ishigami_python", tmp_path)
    text = (folder / "model.toml").read_text().partition("[command]")[0]
    text = text.replace('"command"', '"umbridge"')
    (folder / "model.toml").write_text(f"{text}\n[umbridge]\n{said}\n")
    with pytest.raises(ModelError) as caught:
        read_folder(folder)
    assert str(caught.value) == f"model.toml: {words}"


def test_what_only_mjcf_reads_is_refused_of_other_kinds(tmp_path: Path) -> None:
    folder = edited("ishigami_python", tmp_path, {"[[outputs]]": '[[outputs]]\nsensor = "s"'})
    with pytest.raises(ModelError) as caught:
        read_folder(folder)
    assert str(caught.value) == ("model.toml: outputs[0].sensor is for models of kind mjcf only")
    with pytest.raises(ModelError) as caught:
        read_folder(EXAMPLES / "ishigami_python").check_run({"b", "a"})
    assert str(caught.value).endswith("is unknown: expected a, b")


def test_a_program_says_itself_what_its_curve_is_over(tmp_path: Path) -> None:
    curve = '[[outputs]]\ncurve = 3\nover = "phase"'
    folder = edited("ishigami_python", tmp_path, {"[[outputs]]": curve})
    assert read_folder(folder).description.curves["y"].over == "phase"
    (folder / "model.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ModelError, match=r"^model\.toml: is not UTF-8 text$"):
        read_folder(folder)


def test_files_in_folders_of_the_folder_are_copied_and_too_many_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = edited("pendulum", tmp_path)
    (folder / "a" / "b").mkdir(parents=True)
    (folder / "a" / "b" / "c.csv").write_text("12345")
    read = read_folder(folder)
    assert (copied(read, tmp_path / "copy").path / "a" / "b" / "c.csv").read_text() == "12345"
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    for limits in (replace(LIMITS, files=3), replace(LIMITS, unpacked=size)):
        monkeypatch.setattr("models.folder.LIMITS", limits)
        read_folder(folder)
    for limits in (replace(LIMITS, files=2), replace(LIMITS, unpacked=size - 1)):
        monkeypatch.setattr("models.folder.LIMITS", limits)
        with pytest.raises(ModelError, match="the folder holds 3 files of 0 MB; at most"):
            read_folder(folder)


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = edited("pendulum", tmp_path)
    (folder / "secret").symlink_to("/etc/passwd")
    with pytest.raises(ModelError, match=r"^secret: leads out of the model's folder; keep"):
        read_folder(folder)


def test_an_empty_folder_and_a_zip_without_a_model_say_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"model\.toml: there is no such file"):
        read_folder(tmp_path)
    with zipfile.ZipFile(tmp_path / "m.zip", "w") as archive:
        archive.writestr("../../model.toml", "")
    (tmp_path / "out").mkdir()
    with pytest.raises(ModelError, match=r"^m\.zip: .* no path inside a model's folder"):
        unpacked_into(tmp_path / "m.zip", tmp_path / "out")


def test_a_worker_s_copy_stays_as_it_is(tmp_path: Path) -> None:
    folder = edited("ishigami_python", tmp_path)
    (folder / ".secret.py").write_text("changed without a word")
    read = read_folder(folder)
    copy = copied(read, tmp_path / "copy")
    (folder / "ishigami.py").write_text("print(1)")
    assert read_folder(copy.path).description == read.description
    assert not (copy.path / ".secret.py").exists()
    with pytest.raises(ModelError, match="change while they are copied"):
        copied(read, tmp_path / "late")
