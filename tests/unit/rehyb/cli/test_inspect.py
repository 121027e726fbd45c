"""`rehyb inspect`: what a log seems to hold, and a first session that closing the loop can read."""

import json
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from analysis.closeloop.session.reading import read_session
from rehyb.cli import app

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="forearm"/>
  <joint name="elbow" type="continuous"><parent link="base"/><child link="forearm"/></joint>
</robot>
"""


def log(folder: Path) -> Path:
    """Write a headerless log of one joint: ms, degrees, and a current."""
    time = np.arange(0.0, 4.0, 0.01)
    angle, speed = 40.0 * np.sin(2 * time), 80.0 * np.cos(2 * time)
    table = np.column_stack([1e3 * time, angle, speed, np.cos(time)])
    np.savetxt(folder / "log.csv", table, delimiter=";", fmt="%.5f")
    (folder / "arm.urdf").write_text(URDF)
    return folder / "log.csv"


def test_a_first_session_is_written_in_si_units(tmp_path: Path) -> None:
    file = log(tmp_path)
    ran = CliRunner().invoke(
        app,
        [
            *("inspect", str(file), "--json", "--out", str(tmp_path / "session")),
            *("--model", str(tmp_path / "arm.urdf"), "--as", "column 4=elbow.effort*0.5"),
        ],
    )
    assert ran.exit_code == 0, ran.output
    answer = json.loads(ran.stdout)
    assert [c["seems"] for c in answer["channels"]] == ["time", "position", "velocity", "effort"]
    assert [c["unit"] for c in answer["channels"]] == ["ms", "deg?", "deg/s?", "SI"]
    (clock,) = answer["clocks"]
    assert abs(clock["rate"] - 100.0) < 1e-6 and clock["gaps"] == 0
    header, first, *_ = (tmp_path / "session" / "log.csv").read_text().splitlines()
    assert header == "time,elbow.position,elbow.velocity,elbow.effort"
    assert np.allclose([float(x) for x in first.split(",")], [0.0, 0.0, np.deg2rad(80), 0.5])
    session = read_session(tmp_path / "session", frozenset())
    assert [trial.file for trial in session.trials] == ["log.csv"]


def test_the_table_names_every_channel_and_what_is_left_to_settle(tmp_path: Path) -> None:
    file = log(tmp_path)
    ran = CliRunner().invoke(app, ["inspect", str(file)], env={"COLUMNS": "160"})
    assert ran.exit_code == 0
    assert "4 channels" in ran.stdout and "400 samples at 100 Hz" in ran.stdout
    assert "deg/s" in ran.stdout and "no header" in ran.stdout


def test_a_terminal_too_narrow_for_the_table_gets_a_line_for_each_channel(tmp_path: Path) -> None:
    ran = CliRunner().invoke(app, ["inspect", str(log(tmp_path))], env={"COLUMNS": "70"})
    assert ran.exit_code == 0 and max(map(len, ran.stdout.splitlines()[2:])) <= 70
    said = " ".join(ran.stdout.split())
    assert "column 2: seems position, joint joint_1, unit deg?, least " in said


def test_a_model_that_closing_the_loop_refuses_is_refused_here(tmp_path: Path) -> None:
    file, model, out = log(tmp_path), tmp_path / "arm.urdf", tmp_path / "session"
    model.write_text(URDF.replace('link="forearm"', 'link="foreram"'))
    told = ("--model", str(model), "--as", "column 4=elbow.effort")
    ran = CliRunner().invoke(app, ["inspect", str(file), "--out", str(out), *told])
    assert (
        str(ran.exception).startswith("arm.urdf: joint 'elbow' has the child") and not out.exists()
    )


def test_bad_input_is_one_sentence_and_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("hello\nworld\n")
    out = tmp_path / "session"
    ran = CliRunner().invoke(app, ["inspect", str(tmp_path / "log.csv"), "--out", str(out)])
    assert ran.exit_code != 0 and "holds no signal" in str(ran.exception)
    wrong = CliRunner().invoke(
        app, ["inspect", str(log(tmp_path)), "--as", "nobody=x.effort", "--out", str(out)]
    )
    assert wrong.exit_code == 2 and "no assignment" in wrong.output
    assert not out.exists()


def test_a_unit_in_brackets_stands_in_the_table(tmp_path: Path) -> None:
    rows = [f"{10 * n};{np.sin(0.1 * n):.5f};{n % 7}".replace(".", ",") for n in range(100)]
    text = "Zeit [ms];Gelenkwinkel [°];Motorstrom [mA]\n" + "\n".join(rows)
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    ran = CliRunner().invoke(app, ["inspect", str(tmp_path / "log.csv")], env={"COLUMNS": "160"})
    assert "Zeit [ms]" in ran.stdout and "Motorstrom [mA]" in ran.stdout
    assert "say --as 'Motorstrom [mA]=joint_1.effort*NM_PER_mA'" in ran.stdout


def test_degrees_that_are_assigned_without_a_factor_are_said(tmp_path: Path) -> None:
    ran = CliRunner().invoke(
        app, ["inspect", str(log(tmp_path)), "--as", "column 2=elbow.position"]
    )
    assert "say --as 'column 2=elbow.position*0.0174533'" in ran.stdout


def test_a_log_without_any_joint_says_so(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).normal(size=(60, 2))
    np.savetxt(tmp_path / "log.csv", numbers, header="warmth,score", comments="", delimiter=",")
    ran = CliRunner().invoke(app, ["inspect", str(tmp_path / "log.csv"), "--json"])
    assert ran.exit_code == 0, ran.output
    assert any("no channel seems to be" in line for line in json.loads(ran.stdout)["remarks"])
