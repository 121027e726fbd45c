"""Every bad input of the contract: one error with file, column and line, and nothing written."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.loop import close_loop
from analysis.closeloop.session.mjcf import load_device
from analysis.closeloop.session.reading import read_session, said_of_unread
from models.mjcf.compiling import written
from rehyb.cli import app
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.bad import BAD, constant, csv_text, model, words
from tests.testbed.sessions.small import HEADER, Folder, rows


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A session that is right until a test spoils it."""
    path = tmp_path / "session"
    path.mkdir()
    return Folder(path).write()


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_one_error_that_says_where(folder: Path, what: str) -> None:
    spoil, expected = BAD[what]
    spoil(folder)
    before = sorted(folder.parent.rglob("*"))
    with pytest.raises(SessionError, match=expected) as caught:
        close_loop(folder, folder.parent / "out")
    assert caught.value.file
    assert "\n" not in str(caught.value)
    assert sorted(folder.parent.rglob("*")) == before


def test_the_sound_session_is_read_and_what_nobody_reads_is_told(folder: Path) -> None:
    hanging = {"body": "forearm", "mass_kg": 0.5, "place": [0.1, 0.0, 0.0]}
    words(
        declared_effect=[],
        declared_effects=[{"effect": "coulomb_friction", "joint": "elbow", "torque": 5.0}],
        sensors={
            "elbow.effort": {"noise_rms": 0.05, "rms": 0.05},
            "wrist.effort": {"calibrated": True},
        },
        trials=[{"file": "a.csv", "groupe": "slow", "added_mass": hanging}],
    )(folder)
    session = load_session(folder).session
    assert set(session.unknown) == {
        "declared_effect",
        "declared_effects[0].torque",
        "sensors.elbow.effort.rms",
        "sensors.wrist.effort",
        "trials[0].groupe",
        "trials[0].added_mass.place",
    }


@pytest.mark.parametrize(
    "said",
    [
        'limited="true" range="-inf inf"',
        'range="-1e16 1e16"',
        'actuatorfrcrange="-inf inf"',
        'damping="1e6" armature="1e3" stiffness="1e7"',
    ],
)
def test_a_joint_that_published_files_have_is_taken_and_written_as_it_is(
    folder: Path, said: str
) -> None:
    model('name="elbow"', f'name="elbow" {said}')(folder)
    device = load_device(read_session(folder, tuple(BY_NAME)))
    again = mujoco.MjSpec.from_string(written(device.spec)).compile()
    assert device.range("elbow")[1] in (0.0, pytest.approx(1e16))
    assert again.jnt_limited.tolist() == device.model.jnt_limited.tolist()


@pytest.mark.parametrize("name", ["a.csv", "device.xml", "session.json"])
def test_what_is_no_file_is_not_said_to_be_missing(folder: Path, name: str) -> None:
    for make, said in (
        (Path.mkdir, "is a folder"),
        (os.mkfifo, "is no regular file"),
    ):
        (folder / name).unlink()
        make(folder / name)
        with pytest.raises(SessionError, match=f"^{name}: {said}"):
            load_session(folder)
        (folder / name).rmdir() if make is Path.mkdir else None
        (folder / name).touch()


def test_numbers_of_a_urdf_file_have_the_same_bounds(folder: Path) -> None:
    inertia = 'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"'
    link = f'<inertial><mass value="1"/><inertia {inertia}/></inertial>'
    joint = '<parent link="a"/><child link="b"/><dynamics damping="1e300"/>'
    (folder / "device.xml").write_text(
        f'<robot name="r"><link name="a"/><joint name="elbow" type="continuous">{joint}</joint>'
        f'<link name="b">{link}</link></robot>'
    )
    with pytest.raises(SessionError, match=r"joint 'elbow' has damping=1e\+300"):
        load_device(read_session(folder, tuple(BY_NAME)))


def test_equations_without_a_solution_are_one_sentence_about_the_session(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr("analysis.closeloop.loop.trace", fails)
    with pytest.raises(SessionError, match=r"session.json: .*SVD did not converge") as caught:
        close_loop(folder, folder.parent / "out")
    assert "\n" not in str(caught.value)


def test_a_key_that_means_nothing_is_told_with_the_one_that_it_resembles() -> None:
    assert said_of_unread(()) == []
    assert said_of_unread(("sensors.wrist.effort",)) == [
        "session.json: sensors.wrist.effort means nothing and was not read"
    ]
    assert said_of_unread(("mine",)) == ["session.json: mine means nothing and was not read"]
    assert said_of_unread(("graviti", "trials[0].gruop")) == [
        "session.json: graviti, trials[0].gruop mean nothing and were not read: "
        "is gravity or group meant?"
    ]


@pytest.mark.parametrize(
    ("column", "near"),
    [("elbow.position", "Elbow.position"), ("elbow.position", "elbo.position"), ("time", "Time")],
)
def test_a_column_that_is_missing_is_told_with_the_one_that_it_resembles(
    folder: Path, column: str, near: str
) -> None:
    text = (folder / "a.csv").read_text()
    (folder / "a.csv").write_text(text.replace(column, near, 1))
    with pytest.raises(SessionError, match=rf"{column}.* is missing; .*; is {near} meant\?$"):
        load_session(folder)


def test_an_effort_lost_by_a_slip_of_the_pen_is_told(folder: Path) -> None:
    """The joint went without an effort, and nobody was told."""
    text = (folder / "a.csv").read_text()
    (folder / "a.csv").write_text(text.replace("elbow.velocity", "sholder.effort", 1))
    (trial,) = load_session(folder).session.trials
    assert trial.repairs == (
        "column sholder.effort is no joint's of the model, and shoulder.effort is missing: is it "
        "meant?",
    )


def test_a_file_with_semicolons_and_decimal_commas_is_told_what_is_asked_for(folder: Path) -> None:
    path = folder / "a.csv"
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))
    with pytest.raises(SessionError, match="separate columns by commas and decimals by points"):
        load_session(folder)


def test_a_part_that_goes_beyond_its_file_is_told(folder: Path) -> None:
    words(trials=[{"file": "a.csv", "from": -5.0, "to": 900.0}])(folder)
    (trial,) = load_session(folder).session.trials
    began, ended = [one for one in trial.repairs if "is it meant?" in one]
    assert began.startswith("from is -5 s, and the file begins at 0 s")
    assert ended.startswith("to is 900 s, and the file ends at ")


def test_files_saved_with_a_byte_order_mark_are_read(folder: Path) -> None:
    for path in folder.iterdir():
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    load_session(folder)


def test_every_name_that_the_model_does_not_have_is_told_at_once(folder: Path) -> None:
    """A robot of 13 joints that a simulator alone has took 13 runs to mend."""
    hanging = {"body": "fore", "mass_kg": 0.5}
    words(
        ignored_joints=["a", "shoulder", "b"],
        declared_effects=[{"effect": "viscoelastic_joint", "joint": "c"}],
        trials=[{"file": "a.csv", "added_mass": hanging}],
    )(folder)
    with pytest.raises(SessionError) as caught:
        load_session(folder)
    has = "the model has shoulder, elbow"
    assert str(caught.value).startswith(
        f"session.json: ignored_joints 'a', 'b' are unknown; {has}; "
        "declared_effects[0].joint 'c' is unknown; the model has elbow; "
        "trials[0].added_mass.body 'fore' is unknown; the model has "
    )


def test_an_effort_of_zero_is_refused_with_what_to_do_for_a_joint_without_a_motor(
    folder: Path,
) -> None:
    """A pendulum's pivot was to have its motor's torque recorded."""
    zeros, ones = (
        csv_text(lambda text, value=value: constant(text, 4, value, first=value))
        for value in ("0", "1")
    )
    zeros(folder)
    with pytest.raises(SessionError, match=r"at 0 while elbow moves; .* if it has no motor: its"):
        load_session(folder)
    ones(folder)
    with pytest.raises(SessionError, match=r"at 1 while elbow moves; record the motor's torque$"):
        load_session(folder)


def test_three_hinges_that_lock_as_a_gimbal_in_their_first_position_are_no_fault(
    folder: Path,
) -> None:
    shoulder = '<joint name="shoulder" type="hinge" axis="0 -1 0"/>'
    first = [shoulder.replace("shoulder", name).replace("0 -1 0", "1 0 0") for name in ("a", "b")]
    words(ignored_joints=["a", "b"])(folder)
    model(shoulder, f"{first[0]}{shoulder}{first[1]}")(folder)
    assert load_session(folder).device.joints == ("a", "shoulder", "b", "elbow")


def test_a_folder_that_is_no_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="no such folder"):
        close_loop(tmp_path / "nowhere", tmp_path / "out")


def test_the_command_ends_with_status_2_and_one_sentence(folder: Path) -> None:
    (folder / "a.csv").write_text("time\n")
    out = folder.parent / "out"
    ran = CliRunner().invoke(app, ["close-loop", str(folder), "--out", str(out)])
    # Outside `rehyb.cli.main`, which makes it a sentence and status 2, the error itself arrives.
    assert type(ran.exception).__name__ == "Invalid"
    assert "a.csv, column shoulder.position, line 1" in str(ran.exception)
    assert not out.exists()


def test_a_file_in_place_of_the_folder_is_found_before_the_work(folder: Path) -> None:
    out = folder.parent / "out"
    out.write_text("mine")
    with pytest.raises(NotADirectoryError, match="not a folder"):
        close_loop(folder, out)
    assert out.read_text() == "mine"


def test_large_values_of_time_are_no_fault(folder: Path) -> None:
    table = rows()
    table[:, 0] += 1.7e9
    lines = [",".join(f"{x:.14g}" for x in row) for row in table]
    (folder / "a.csv").write_text("\n".join([HEADER, *lines]) + "\n")
    recording = load_session(folder)
    assert np.isfinite(recording.acceleration).all()
